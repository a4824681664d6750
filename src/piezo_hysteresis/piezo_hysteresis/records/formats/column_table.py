"""Tables of named columns, as the readers of all formats give them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import meaning

#: More rows than columns, and no more columns than this: an array of columns.
MOST_COLUMNS = 64
# Scalars that state the sampling interval [s] or the rate [Hz].
_INTERVALS = ('dt', 'ts', 'sample_time', 'sampletime', 'sampling_interval')
_RATES = ('fs', 'rate', 'sample_rate', 'samplerate', 'sampling_rate')


@dataclass(frozen=True)
class ColumnTable:
    """Columns of equal length.

    Attributes
    ----------
    name : str
        Of the part of the file (sheet, group, struct); empty for the file itself.
    columns : dict of ndarray, shape (n,)
        By their names.
    """

    name: str
    columns: dict[str, FloatArray]


def vector(value: Any) -> FloatArray | None:
    """Return real numbers in a row as floats; times in seconds from the first. None for others."""
    array = np.squeeze(np.asarray(value))
    if array.ndim != 1 or array.size < 2:
        return None
    if array.dtype.kind == 'M':
        return np.asarray((array - array[0]) / np.timedelta64(1, 'ns') / 1e9, np.float64)
    if array.dtype.kind not in 'biuf':
        return None
    return np.asarray(array, np.float64)


def tables_of(entries: Mapping[str, Any], name: str = '') -> Iterator[ColumnTable]:
    """Yield the tables of nested mappings of arrays and scalars, such as structs and groups.

    Columns of arrays are numbered from 1. A scalar ``dt`` [s] or ``fs`` [Hz] defines the time.

    Raises
    ------
    RecordError
        If assigned columns differ in length.
    """
    columns: dict[str, FloatArray] = {}
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from tables_of(value, _below(name, key))
            continue
        if isinstance(value, list):
            for k, each in enumerate(value, 1):
                if isinstance(each, Mapping):
                    yield from tables_of(each, _below(name, f'{key}_{k}'))
            continue
        columns.update(_columns(key, value, len(entries) == 1))
    columns = _of_one_length(columns)
    if len(columns) >= 2:
        yield ColumnTable(name, _with_time(columns, entries))


def _below(name: str, key: str) -> str:
    return f'{name}_{key}' if name else key


def _columns(key: str, value: Any, alone: bool) -> dict[str, FloatArray]:
    """Return the columns of one entry: a vector, fields of a structured array, or an array."""
    array = np.asarray(value)
    if array.dtype.names:
        found = {field: vector(array[field]) for field in array.dtype.names}
        return {field: column for field, column in found.items() if column is not None}
    if (column := vector(array)) is not None:
        is_time = array.dtype.kind == 'M' and not meaning(key).unit
        return {f'{key}_s' if is_time else key: column}
    if array.ndim != 2 or array.dtype.kind not in 'biuf' or min(array.shape) > MOST_COLUMNS:
        return {}
    rows = array if array.shape[0] >= array.shape[1] else array.T
    if rows.shape[0] < 2:
        return {}
    numbers = range(1, rows.shape[1] + 1)
    return {
        (str(k) if alone else f'{key}_{k}'): np.asarray(rows[:, k - 1], np.float64)
        for k in numbers
    }


def _of_one_length(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns as long as those that mean something, else as long as most."""
    known = {key: column.size for key, column in columns.items() if meaning(key).what}
    if len(set(known.values())) > 1:
        listed = ', '.join(f'{key} {size}' for key, size in known.items())
        raise RecordError(
            f'its columns differ in length ({listed}): two rates are no record; save those of one '
            'rate together'
        )
    sizes = list(known.values()) or [column.size for column in columns.values()]
    if not sizes:
        return {}
    length = Counter(sizes).most_common(1)[0][0]
    return {key: column for key, column in columns.items() if column.size == length}


def _with_time(
    columns: dict[str, FloatArray], entries: Mapping[str, Any]
) -> dict[str, FloatArray]:
    """Return the columns with a time from the given interval or rate."""
    if any(meaning(key).what == 'time' for key in columns):
        return columns
    dt = interval_of(entries)
    if dt <= 0.0:
        return columns
    time = np.asarray(dt * np.arange(next(iter(columns.values())).size), np.float64)
    return {'time_s': time, **columns}


def interval_of(entries: Mapping[str, Any]) -> float:
    """Return the sampling interval [s] from scalars; 0 if none states it."""
    for key, value in entries.items():
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
