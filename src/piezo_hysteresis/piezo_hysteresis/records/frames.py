"""Records from columns in memory: a dictionary of arrays, or a data frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import UNITS, assigned, meaning
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.record import Record, RecordInfo
from piezo_hysteresis.records.sampling import Track, records_of
from piezo_hysteresis.records.tabular import in_si

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


def frame_records(given: Columns, name: str, dt: float | None, log: DamageLog) -> list[Record]:
    """Return columns in memory as one record, or as its intact pieces when salvaging.

    Parameters
    ----------
    given : mapping of str to array_like, shape (n,), or data frame
        Columns named as in a CSV file; a quantity without its unit is in SI units.
    name : str
        Name of the record.
    dt : float or None
        Sampling interval [s], for columns without a time.
    log : DamageLog
        Where damage is listed, or raised.

    Raises
    ------
    RecordError
        If the columns are no record.
    """
    columns = _columns_of(given)
    names = [_with_unit(each) for each in columns]
    timed = any(meaning(each).what == 'time' for each in names)
    if timed and dt is not None:
        raise RecordError(f'{_WHERE} have a time; leave dt out')
    if not timed:
        names, columns = _timed(names, columns, dt)
    meanings, guessed = assigned(names, _WHERE, of_file=False)
    if guessed:
        log.guess(_WHERE, f'reading {guessed}')
    found = in_si(dict(enumerate(columns.values())), meanings)
    info = RecordInfo(input_unit='N') if 'force' in found else RecordInfo()
    found['voltage'] = found.pop('force', found.get('voltage', np.empty(0)))
    time = found.pop('time')
    if dt is not None and not log.salvage:
        voltage, displacement = found['voltage'], found['displacement']
        reference = found.get('reference')
        return [Record(name, float(dt), voltage, displacement, reference=reference, info=info)]
    track = Track(name, time, found, info=info, rate=0.0 if dt is None else 1.0 / dt)
    return records_of(track, _WHERE, log)


def _columns_of(given: Columns) -> dict[str, FloatArray]:
    """Return all columns of numbers, each of shape (n,)."""
    if isinstance(given, Mapping):
        raw: dict[str, Any] = {str(name): column for name, column in given.items()}
    else:
        known = getattr(given, 'column_names', given.columns)  # of Arrow and of the others
        raw = {str(name): given[name] for name in known}
        index = getattr(given, 'index', None)
        label = getattr(index, 'name', None)
        if isinstance(label, str) and label not in raw:
            raw[label] = index
    columns: dict[str, FloatArray] = {}
    for name, column in raw.items():
        try:
            columns[name] = np.asarray(column, dtype=np.float64)
        except (TypeError, ValueError):
            if meaning(_with_unit(name)).what:
                raise RecordError(f'column {name} holds values that are not numbers') from None
    lengths = {name: column.shape for name, column in columns.items()}
    if any(len(shape) != 1 for shape in lengths.values()) or len(set(lengths.values())) > 1:
        listed = ', '.join(f'{name} {shape}' for name, shape in lengths.items())
        raise RecordError(f'columns must be of equal length, one number a sample; got {listed}')
    return columns


def _with_unit(name: str) -> str:
    """Return the name of a column; a bare quantity is given its SI unit."""
    bare = name.strip().lower()
    return f'{bare}_{next(iter(UNITS[bare]))}' if bare in UNITS else name


def _timed(
    names: list[str], columns: dict[str, FloatArray], dt: float | None
) -> tuple[list[str], dict[str, FloatArray]]:
    """Return names and columns with a time in front."""
    if dt is None:
        raise RecordError(f'{_WHERE} have no time; name one time_s, or give dt [s]')
    if not (isinstance(dt, (int, float)) and np.isfinite(dt) and dt > 0):
        raise RecordError(f'dt must be a positive number [s], got {dt!r}')
    size = next(iter(columns.values())).size if columns else 0
    time = np.arange(size, dtype=np.float64) * dt
    return ['time_s', *names], {'': time, **columns}
