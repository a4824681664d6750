"""Tables of columns, as the readers of all formats give them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    """Yield the tables of arrays and scalars by name; `struct_tables` reads nested ones.

    Columns of arrays are numbered from 1. A scalar ``dt`` [s] or ``fs`` [Hz] defines the time.
    An array of more dimensions is one table for each of its first indices.
    """
    columns: list[Column] = []
    for key, value in entries.items():
        if isinstance(value, list):
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


SIMULINK = 'read as Simulink structure with time: its signals share the field time'
CONTROLDESK = 'read as ControlDesk recording: each Y has the times of its X'
SIGNALS = 'read as signals with times of their own (timeseries or Dataset as struct)'


def struct_tables(entries: Mapping[str, Any], name: str = '') -> Iterator[ColumnTable]:
    """Yield the tables of nested structs; those of Simulink and ControlDesk by their rules."""
    columns, kind = _recording(entries)
    if columns:
        yield ColumnTable(name, columns, assumed=(kind,))
        return
    signals: list[Column] = []
    rest: dict[str, Any] = {}
    for key, value in entries.items():
        below = _below(name, key)
        if isinstance(value, Mapping):
            single = _signal(value, key)
            if single:
                signals += single
            else:
                yield from struct_tables(value, below)
        elif isinstance(value, list) and any(isinstance(each, Mapping) for each in value):
            structs = [each for each in value if isinstance(each, Mapping)]
            found = [column for each in structs for column in _signal(each, key)]
            signals += found
            for k, each in enumerate(structs if not found else [], 1):
                yield from struct_tables(each, f'{below}_{k}')
        else:
            rest[key] = value
    if signals:
        yield ColumnTable(name, signals, assumed=(SIGNALS,))
    yield from tables_of(rest, name)


def _list(value: Any) -> list[Mapping[str, Any]]:
    """Return one struct or an array of structs as a list; nothing for other values."""
    if isinstance(value, Mapping):
        return [value]
    values = value if isinstance(value, list) else np.asarray(value, object).reshape(-1).tolist()
    return [each for each in values if isinstance(each, Mapping)]


def _recording(entries: Mapping[str, Any]) -> tuple[list[Column], str]:
    """Return the signals of a structure with time, or of a ControlDesk recording."""
    if 'signals' in entries and 'time' in entries:
        time = vector(entries['time'])
        columns = [
            each
            for k, signal in enumerate(_list(entries['signals']), 1)
            for each in _split(str(signal.get('label') or k), signal.get('values'), '')
        ]
        if time is not None:
            columns = [Column('time', time, known=Meaning('time', 's', 1)), *columns]
        return columns, SIMULINK
    axes, signals = _list(entries.get('X')), _list(entries.get('Y'))
    if not axes or not any('Data' in each for each in signals):
        return [], ''
    columns = []
    for signal in signals:
        place = int(np.asarray(signal.get('XIndex', 1)).reshape(-1)[0]) - 1
        time = vector(axes[min(max(place, 0), len(axes) - 1)].get('Data'))
        found = _split(_text(signal.get('Name')), signal.get('Data'), _text(signal.get('Unit')))
        columns += [replace(each, time=time) for each in found]
    return columns, CONTROLDESK


def _signal(entry: Mapping[str, Any], key: str) -> list[Column]:
    """Return the columns of a struct with Time and Data (perhaps below Values)."""
    inner = entry.get('Values') if isinstance(entry.get('Values'), Mapping) else entry
    fields = {name.lower(): value for name, value in (inner or {}).items()}
    time, data = vector(fields.get('time', ())), fields.get('data')
    if time is None or data is None:
        return []
    about = fields.get('datainfo')
    unit = _text(about.get('Units') if isinstance(about, Mapping) else fields.get('units'))
    name = _text(entry.get('Name', entry.get('name'))) or _text(fields.get('name')) or key
    return [replace(each, time=time) for each in _split(name, data, unit)]


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ''


def _split(name: str, values: Any, unit: str) -> list[Column]:
    """Return one column, or one for each channel of a signal with several."""
    if values is None:
        return []
    single = vector(values)
    if single is not None:
        return [Column(with_unit(name, unit), single)]
    array = np.squeeze(np.asarray(values))
    if array.ndim != 2 or array.dtype.kind not in 'biuf':
        return []
    rows: FloatArray = np.asarray(array if array.shape[0] >= array.shape[1] else array.T, float)
    return [Column(with_unit(f'{name}_{k + 1}', unit), rows[:, k]) for k in range(rows.shape[1])]
