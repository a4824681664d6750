"""Records from and to named columns, and metadata in ``records.yaml`` next to a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.files import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import LENGTHS, UNITS
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.record import Record, RecordInfo
from piezo_hysteresis.records.sampling import Track, records_of

INFO_FILE = 'records.yaml'


def in_si(
    columns: Mapping[int, FloatArray], meanings: Mapping[int, tuple[str, str]]
) -> dict[str, FloatArray]:
    """Return columns in SI units by quantity, see `columns.assigned`."""
    return {what: columns[k] / UNITS[what][unit] for k, (what, unit) in meanings.items()}


def columns_of(record: Record, unit: str = 'um') -> dict[str, FloatArray]:
    """Return a record as named columns, ``time_s, voltage_V, displacement_um``.

    Parameters
    ----------
    record : Record
        Has ``force_N`` if its input is a force, and a reference if it has one.
    unit : str
        Unit of the displacement: m, mm, um or nm. In ``m`` every number is exact.

    Raises
    ------
    RecordError
        If the unit is unknown.
    """
    if unit not in LENGTHS:
        raise RecordError(f'unit {unit!r} is not known; use m, mm, um or nm')
    columns = {}
    for name, column in record.columns().items():
        what, _, own = name.rpartition('_')
        length = own == 'm'
        columns[f'{what}_{unit}' if length else name] = (
            column * LENGTHS[unit] if length else column
        )
    return columns


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Provide a temporary name for a file that appears only when it is complete.

    Raises
    ------
    RecordError
        If the file exists or cannot be written; no partial file remains.
    """
    if path.exists():
        raise RecordError(f'{path} exists already; remove it or choose another name')
    try:
        with write_atomically(path) as temporary:
            yield temporary
    except OSError as error:
        raise RecordError(f'{path}: it cannot be written ({reason_of(error)})') from None


def records_from(
    path: Path, columns: dict[str, FloatArray], log: DamageLog, part: str = ''
) -> list[Record]:
    """Return the columns of a file as one record, or as its intact parts when salvaging.

    Parameters
    ----------
    path : Path
        File.
    columns : dict of ndarray, shape (n,)
        ``time`` [s], ``voltage`` [V] or ``force`` [N], ``displacement`` [m], perhaps ``reference``
        [m].
    log : DamageLog
        Lists or raises damage.
    part : str
        Name of the part of the file (sheet, group, struct) if it has several.

    Raises
    ------
    RecordError
        If no part of it is readable.
    """
    info, name, rate = _about(path)
    columns = dict(columns)
    if 'force' in columns:
        columns['voltage'] = columns.pop('force')
        info = RecordInfo(**{**asdict(info), 'input_unit': 'N'})
    time = columns.pop('time')
    track = Track(f'{name}_{part}' if part else name, time, columns, info=info, rate=rate)
    records = records_of(track, str(path), log)
    if not records:
        raise RecordError(f'{path}: nothing of it is readable as a record')
    return records


def _about(path: Path) -> tuple[RecordInfo, str, float]:
    """Return metadata, name and rate of a file from ``records.yaml`` next to it."""
    notes = path.with_name(INFO_FILE)
    entry: Any = None
    if notes.is_file():
        try:
            entry = (plain_yaml.load_file(notes) or {}).get(path.name)
        except (OSError, yaml.YAMLError, AttributeError) as error:
            reason = reason_of(error)
            raise RecordError(
                f'{notes}: it cannot be read ({reason}); correct or remove it'
            ) from None
    if not isinstance(entry, dict):
        return RecordInfo(), path.stem, 0.0
    try:
        known = {
            item.name: type(getattr(RecordInfo(), item.name))(entry[item.name])
            for item in fields(RecordInfo)
            if item.name in entry
        }
        return (
            RecordInfo(**known),
            str(entry.get('record', path.stem)),
            float(entry.get('rate', 0)),
        )
    except (TypeError, ValueError, OverflowError):
        raise RecordError(
            f'{notes}: the entry of {path.name} has a value of the wrong kind; mend it'
        ) from None
