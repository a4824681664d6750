"""Igor binary wave (``.ibw``): the columns of a wave of two dimensions."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import UNITS
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import ColumnTable, column

# Version 5: bytes that its checksum covers, and of the part in front of the wave.
_VERSION, _HEADER, _PARTS = 5, 384, 64


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield one table: the columns of a wave, by their dimension labels or numbers."""
    from igor2 import binarywave

    sizes.judge(path.stat().st_size)
    logging.getLogger('igor2').setLevel(logging.CRITICAL)  # it prints the bytes of a damaged file
    _refuse_damage(path)
    wave = binarywave.load(str(path))['wave']
    values, header = np.asarray(wave['wData']), wave['wave_header']
    if values.ndim != 2:
        raise RecordError(
            f'its wave has {values.ndim} dimension(s); save voltage and displacement as the '
            'columns of one wave'
        )
    labels = [_text(each) for each in wave['labels'][1][1:]]
    names = [each or str(k) for k, each in enumerate([*labels, *[''] * values.shape[1]], 1)]
    found = [column(name, each) for name, each in zip(names, values.T, strict=False)]
    columns = [each for each in found if each is not None]
    unit, step = _text(b''.join(np.ravel(header['dimUnits'][0]))), float(header['sfA'][0])
    interval = step / UNITS['time'][unit] if unit in UNITS['time'] else 0.0
    assumed = ('read as Igor wave: rows are the row scaling apart where that is in seconds',)
    yield ColumnTable('', columns, interval, assumed=assumed)


def _refuse_damage(path: Path) -> None:
    """Refuse a wave of version 5 whose header or length is not as it was written."""
    with path.open('rb') as file:
        header = file.read(_HEADER)
    order = '<' if header[:1] == b'\x05' else '>'
    if len(header) < _HEADER or struct.unpack_from(f'{order}h', header)[0] != _VERSION:
        return
    if sum(struct.unpack(f'{order}{_HEADER // 2}h', header)) & 0xFFFF:
        raise RecordError('the checksum of its header is wrong; save it again')
    stated = _PARTS + sum(struct.unpack_from(f'{order}13i', header, 4))
    if path.stat().st_size > stated:
        raise RecordError(f'it is longer than the {stated} bytes that it states; save it again')


def _text(raw: Any) -> str:
    return bytes(raw).split(b'\0')[0].decode('utf-8', 'replace').strip()
