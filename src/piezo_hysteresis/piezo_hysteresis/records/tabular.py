"""Records as named columns and as CSV, and metadata in ``records.yaml`` next to a file."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import LENGTHS
from piezo_hysteresis.records.record import Record, RecordInfo

INFO_FILE = 'records.yaml'


def columns_of(record: Record, unit: str = 'um') -> dict[str, FloatArray]:
    """Return a record as named columns, ``time_s, voltage_V, displacement_um``."""
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
    """Provide a temporary name for a file that appears only when it is complete."""
    if path.exists():
        raise RecordError(f'{path} exists already; remove it or choose another name')
    try:
        with write_atomically(path) as temporary:
            yield temporary
    except OSError as error:
        raise RecordError(f'{path}: it cannot be written ({reason_of(error)})') from None


def write_csv(path: str | Path, record: Record, *, unit: str = 'um') -> None:
    """Write one record with the columns ``time_s, voltage_V, displacement_um``.

    Parameters
    ----------
    path : str or Path
        File to create.
    record : Record
        Record to write, with ``force_N`` if its input is a force, and the reference if it has one.
    unit : str
        Unit of the displacement: m, mm, um or nm.  In ``m`` every number is exact.

    Raises
    ------
    RecordError
        If the file exists or cannot be written; no partial file remains.
    """
    with new_file(Path(path)) as temporary:
        temporary.write_text(csv_text(record, unit=unit), 'utf-8')


def csv_text(record: Record, *, unit: str = 'um') -> str:
    """Return the content of the file that `write_csv` writes."""
    columns = columns_of(record, unit)
    text = io.StringIO()
    text.write(','.join(columns) + '\n')
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    text.writelines(f'{time:.12g},' + ','.join(map(repr, values)) + '\n' for time, *values in rows)
    return text.getvalue()


def about(path: Path) -> tuple[RecordInfo, str, float]:
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
