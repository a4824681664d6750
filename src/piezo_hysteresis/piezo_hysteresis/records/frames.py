"""Records from columns in memory: a dictionary of arrays, or a data frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.array_pairs import ArrayPair, refuse_pair
from piezo_hysteresis.records.columns import UNITS, ReadOptions, meaning
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, column
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.sampling import records_of
from piezo_hysteresis.records.table_reader import track_of

_WHERE = 'the data'


@runtime_checkable
class DataFrameLike(Protocol):
    """A data frame of pandas or polars, or a table of Arrow."""

    @property
    def columns(self) -> Iterable[Any]:
        """Names of the columns."""

    def __getitem__(self, name: Any, /) -> Any:
        """Return one column."""


Columns: TypeAlias = Mapping[str, ArrayLike] | DataFrameLike
#: Voltage and displacement, perhaps after the time; or a table of them, one column each.
Arrays: TypeAlias = FloatArray | tuple[ArrayLike, ...]
_ORDER = ('time', 'voltage', 'displacement')


def columns_of_arrays(given: object) -> dict[str, Any] | None:
    """Return columns by name for two or three arrays, or a table of them; None for other data."""
    if isinstance(given, np.ndarray) and given.ndim == 2:
        given = tuple(given if given.shape[0] <= len(_ORDER) else given.T)
    if not isinstance(given, (tuple, list)) or len(given) not in (2, 3):
        return None
    if not all(isinstance(each, (np.ndarray, tuple, list)) and len(each) for each in given):
        return None
    try:
        arrays = [np.asarray(each, np.float64) for each in given]
    except (TypeError, ValueError):
        return None
    return dict(zip(_ORDER[-len(arrays) :], arrays, strict=True))


def frame_records(given: Columns, name: str, log: DamageLog, options: ReadOptions) -> list[Record]:
    """Return columns in memory as one record, or as its intact pieces when salvaging."""
    # given (n,)
    columns, log = columns_in(given), log.at(_WHERE)
    timed = any((each.known or meaning(each.name)).what == 'time' for each in columns)
    if timed and options.interval is not None:
        raise RecordError(f'{_WHERE} have a time; leave dt out')
    if not timed and options.interval is None:
        raise RecordError(f'{_WHERE} have no time; name one time_s, or give dt [s]')
    track = track_of(ColumnTable('', columns), name, log, options, of_file=False)
    if options.interval is not None and not log.salvage:
        return [replace(track, dt=float(options.interval)).record()]
    return records_of(track, log)


def columns_in(given: Columns) -> list[Column]:
    """Return all columns of numbers or times, each of shape (n,)."""
    if isinstance(given, Mapping):
        raw: dict[str, Any] = {str(name): values for name, values in given.items()}
    else:
        known = getattr(given, 'column_names', given.columns)  # of Arrow and of the others
        raw = {str(name): given[name] for name in known}
        index = getattr(given, 'index', None)
        label = getattr(index, 'name', None)
        if isinstance(label, str) and label not in raw:
            raw[label] = index
        elif label is None and getattr(getattr(index, 'dtype', None), 'kind', '') in ('m', 'M'):
            raw = {'time': index, **raw}
    columns = []
    shapes = {}
    for name, values in raw.items():
        array = np.asarray(values)
        found = column(_with_unit(name), array) if array.ndim == 1 else None
        if found is None and not meaning(_with_unit(name)).what and array.dtype.kind not in 'biuf':
            continue
        if found is None and array.dtype.kind not in 'biuf':
            raise RecordError(f'column {name} holds values that are not numbers')
        shapes[name] = array.shape
        columns.append(found or Column(_with_unit(name), np.asarray(array, np.float64)))
    if shapes.keys() == {'voltage', 'displacement'}:
        arrays = (np.asarray(raw['voltage']), np.asarray(raw['displacement']))
        refuse_pair(_WHERE, ArrayPair('', ('u', 'y'), *arrays))
    if any(len(shape) != 1 for shape in shapes.values()) or len(set(shapes.values())) > 1:
        listed = ', '.join(f'{name} {shape}' for name, shape in shapes.items())
        raise RecordError(f'columns must be of equal length, one number a sample; got {listed}')
    return columns


def _with_unit(name: str) -> str:
    """Return the name of a column; a bare quantity is given its SI unit."""
    bare = name.strip().lower()
    return f'{bare}_{next(iter(UNITS[bare]))}' if bare in UNITS else name
