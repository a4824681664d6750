"""Bags to damage, and what every refusal has to do."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from rosbags.convert.converter import convert

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import (
    DamageWarning,
    Record,
    RecordInfo,
    bag_writer,
    cdr,
    load,
    mcap_format,
    survey,
    write_bag,
)
from piezo_hysteresis.records.definitions import STATE, definition_of
from piezo_hysteresis.records.load import Survey
from piezo_hysteresis.records.recorder import Recorder

FIELDS = bag_writer.fixed_fields(STATE)
NAME = '/piezo/actuator/state'


def make(n: int = 1000, name: str = 'a', **info: Any) -> Record:
    ticks = np.arange(n, dtype=np.float64)
    return Record(name, 1e-3, ticks / 256, 1e-9 * ticks, info=RecordInfo(**info))


def write_stored(path: Path, records: Sequence[Record], storage: str) -> None:
    """Write records as a bag of a storage; sqlite3 as another program makes it of mcap."""
    if storage == 'mcap':
        write_bag(path, records)
        return
    plain = path.with_name(f'{path.name}_mcap')
    write_bag(plain, records)
    convert([plain], path, storage, 9, None, 'none', None, None, (), (), (), ())
    shutil.rmtree(plain)


def raw_bag(path: Any, parts: Any, topic: Any = NAME, *, in_order: bool = False) -> Any:
    """Write states of (sample numbers, stamps [s], displacements) as a driver would send them."""
    with Recorder(path) as recorder:
        for part, (sample, stamp, displacement) in enumerate(parts):
            name = topic if len(parts) == 1 else f'/{"abc"[part]}/actuator/state'
            number = recorder.add_topic(name, STATE, definition=definition_of(STATE)[0])
            stamps = np.round(np.asarray(stamp) * 1e9).astype(np.int64)
            columns = {'sample': sample, 'voltage': np.asarray(sample) * 1.0,
                       'displacement': displacement}  # fmt: skip
            rows = cdr.encode(FIELDS, stamps, columns)
            times = np.arange(stamps.size) if in_order else stamps
            for row, time in zip(rows, times.tolist(), strict=True):
                recorder.write(number, row.tobytes(), time)
    return path


def refused(path: Any, message: Any) -> Survey:
    """Check that reading refuses in one sentence, and that salvaging counts something."""
    with pytest.raises(RecordError, match=message) as caught:
        load([path])
    assert '\n' not in str(caught.value)
    assert '--salvage' in str(caught.value)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter('always')
        load([path], salvage=True)
    assert any(issubclass(item.category, DamageWarning) for item in warned)
    found = survey([path], salvage=True)
    assert found.damage
    return found


TICKS = np.arange(300)
STROKE = 1e-9 * TICKS


def mcap_of(tmp_path: Any) -> Any:
    write_bag(tmp_path / 'bag', [make(100_000)])
    file = tmp_path / 'bag' / 'bag_0.mcap'
    return file, bytearray(file.read_bytes())


def chunk_starts(data: Any) -> list[Any]:
    walk = mcap_format.walk(np.frombuffer(bytes(data[8:]), np.uint8))
    return [at + 8 for code, at, _ in walk.others.tolist() if code == mcap_format.CHUNK]


def mcap_crc(content: Any) -> bytes:
    return crc32(content).to_bytes(4, 'little')
