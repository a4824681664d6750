"""Tables of columns, as the readers of all formats give them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.columns import Meaning, stamped, with_unit

#: No more columns than this: an array of columns.
MOST_COLUMNS = 64
# Scalars that state the sampling interval [s] or the rate [Hz].
_INTERVALS = ('dt', 'ts', 'sample_time', 'sampletime', 'sampling_interval')
_RATES = ('fs', 'rate', 'sample_rate', 'samplerate', 'sampling_rate')


@dataclass(frozen=True)
class Column:
    """One column, or one channel with a clock of its own."""

    name: str  # with its unit, if the file states one
    values: FloatArray  # numbers; NaN where there is none, shape (n,)
    time: FloatArray | None = None  # its own times [s]; None if the table has a time, shape (n,)
    known: Meaning | None = None  # what it is by the format of the file


@dataclass(frozen=True)
class ColumnTable:
    """Columns of one part of a file."""

    name: str  # of the part of the file (sheet, group, struct, segment); empty for the file itself
    columns: list[Column]  # in the order of the file
    interval: float = 0.0  # sampling interval that the file states [s]; 0 if none
    count: int = 0  # number of samples that the file states; 0 if none
    assumed: tuple[str, ...] = field(default=())  # what it was recognised as
    repeats: tuple[int, ...] = field(default=())
    sparse: bool = False  # a row may hold one signal only; the others hold their value


def vector(value: Any) -> FloatArray | None:
    """Return real numbers in a row as floats; times in seconds from the first. None for others."""
    array = np.squeeze(np.asarray(value))
    if array.ndim != 1 or array.size < 2:
        return None
    if array.dtype.kind == 'O':
        return _of_objects(array)
    if array.dtype.kind == 'M':
        array = array - array[0]
    if array.dtype.kind == 'm':
        return np.asarray(array / np.timedelta64(1, 'ns') / 1e9, np.float64)
    if array.dtype.kind not in 'biuf':
        return None
    return np.asarray(array, np.float64)


def is_time(value: Any) -> bool:
    """Return whether a column holds dates or durations, which `vector` converts to seconds."""
    array = np.asarray(value)
    if array.dtype.kind == 'O' and array.size:
        first = array.reshape(-1)[0]
        return hasattr(first, 'timestamp') or isinstance(first, timedelta)
    return array.dtype.kind in 'mM'


def _of_objects(array: Any) -> FloatArray | None:
    """Return numbers, dates or durations of Python as floats; None for others."""
    try:
        if is_time(array):
            first = array[0] if hasattr(array[0], 'timestamp') else timedelta(0)
            return np.array([(each - first).total_seconds() for each in array])
        return np.array([np.nan if each is None else float(each) for each in array])
    except (TypeError, ValueError, AttributeError):
        return None


def column(name: str, value: Any, unit: str = '') -> Column | None:
    """Return a column of numbers or times; None for others."""
    found = vector(value)
    if found is None:
        return None
    if is_time(value):  # in seconds, whatever its name says
        return Column(name, found, known=stamped(name))
    return Column(with_unit(name, unit), found)


def tables_of(entries: Mapping[str, Any], name: str = '') -> Iterator[ColumnTable]:
    """Yield the tables of nested mappings of arrays and scalars, such as structs and groups.

    Columns of arrays are numbered from 1. A scalar ``dt`` [s] or ``fs`` [Hz] defines the time.
    An array of more dimensions is one table for each of its first indices.
    """
    columns: list[Column] = []
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from tables_of(value, _below(name, key))
            continue
        if isinstance(value, list):
            for k, each in enumerate(value, 1):
                if isinstance(each, Mapping):
                    yield from tables_of(each, _below(name, f'{key}_{k}'))
            continue
        array = np.asarray(value)
        if array.ndim == 3 and array.dtype.kind in 'biuf':
            for k, each in enumerate(array, 1):
                found = _columns(key, each, True)
                if len(found) >= 2:
                    yield ColumnTable(_below(name, f'{key}_{k}'), found, interval_of(entries))
            continue
        columns += _columns(key, value, len(entries) == 1)
    if columns:
        yield ColumnTable(name, columns, interval_of(entries))


def united(tables: Sequence[ColumnTable]) -> ColumnTable:
    """Return the columns of all tables as one: a file with one channel in each group."""
    names = [each.name for table in tables for each in table.columns]
    columns = [
        Column(
            each.name if names.count(each.name) == 1 else _below(table.name, each.name),
            each.values,
            each.time if each.time is not None else _clock(table, each),
            each.known,
        )
        for table in tables
        for each in table.columns
    ]
    assumed = dict.fromkeys(sentence for table in tables for sentence in table.assumed)
    return ColumnTable('', columns, assumed=tuple(assumed))


def _clock(table: ColumnTable, each: Column) -> FloatArray | None:
    if table.interval <= 0.0:
        return None
    return np.asarray(table.interval * np.arange(each.values.size), np.float64)


def _below(name: str, key: str) -> str:
    return f'{name}_{key}' if name else key


def _columns(key: str, value: Any, alone: bool) -> list[Column]:
    """Return the columns of one entry: a vector, fields of a structured array, or an array."""
    array = np.asarray(value)
    if array.dtype.names:
        found = [column(field, array[field]) for field in array.dtype.names]
        return [each for each in found if each is not None]
    if (single := column(key, value)) is not None:
        return [single]
    if array.ndim != 2 or array.dtype.kind not in 'biuf' or min(array.shape) > MOST_COLUMNS:
        return []
    rows = array if array.shape[0] >= array.shape[1] else array.T
    if rows.shape[0] < 2:
        return []
    return [
        Column(str(k) if alone else f'{key}_{k}', np.asarray(rows[:, k - 1], np.float64))
        for k in range(1, rows.shape[1] + 1)
    ]


def interval_of(entries: Mapping[str, Any]) -> float:
    """Return the sampling interval [s] from scalars; 0 if none states it."""
    for key, value in entries.items():
        if isinstance(value, Mapping | list):
            continue
        array = np.asarray(value)
        if array.size != 1 or array.dtype.kind not in 'iuf':
            continue
        number = float(array.reshape(-1)[0])
        if not np.isfinite(number) or number <= 0.0:
            continue
        if key.lower() in _INTERVALS:
            return number
        if key.lower() in _RATES:
            return 1.0 / number
    return 0.0
