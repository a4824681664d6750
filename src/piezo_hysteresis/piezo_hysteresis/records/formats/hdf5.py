"""HDF5: one table for each group with vectors; MATLAB 7.3 is HDF5, too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.formats.column_table import ColumnTable, tables_of


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a file; scalars may be data sets or attributes.

    Raises
    ------
    RecordError
        If it holds MATLAB objects only.
    """
    import h5py

    with h5py.File(path, 'r') as file:
        found = list(tables_of(_entries(file, h5py)))
        objects = [name for name, item in file.items() if _is_object(item)]
    if not found and objects:
        raise object_refused(objects)
    yield from found


def object_refused(names: Sequence[str]) -> RecordError:
    """Return the error with the instruction to save objects that only MATLAB can read."""
    return RecordError(
        f'{", ".join(names)} is a MATLAB object (table, timetable, iddata), which only MATLAB '
        "reads; save its columns as vectors: save('x.mat', 'time_s', 'voltage_V', "
        "'displacement_um')"
    )


def _is_object(item: Any) -> bool:
    return 'MATLAB_object_decode' in item.attrs


def _entries(group: Any, h5py: Any) -> dict[str, Any]:
    found: dict[str, Any] = dict(group.attrs)
    for name, item in group.items():
        if name.startswith('#'):  # what MATLAB refers to
            continue
        if isinstance(item, h5py.Group):
            found[name] = _entries(item, h5py)
        elif isinstance(item, h5py.Dataset) and item.shape is not None and not _is_object(item):
            found[name] = item[()]
    return found


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    import h5py

    with h5py.File(path, 'w') as file:
        for name, column in columns.items():
            file[name] = column
