"""Structs of Simulink and ControlDesk: signals next to their times, in any container."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.columns import Meaning, with_unit
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, tables_of, vector

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
        below = f'{name}_{key}' if name else key
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
