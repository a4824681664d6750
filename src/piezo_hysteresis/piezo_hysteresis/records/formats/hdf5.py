"""HDF5: one table for each group with vectors; MATLAB 7.3 is HDF5, too."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.formats.table import ColumnTable, tables_of


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a file; scalars may be data sets or attributes."""
    import h5py

    with h5py.File(path, 'r') as file:
        yield from tables_of(_entries(file, h5py))


def _entries(group: Any, h5py: Any) -> dict[str, Any]:
    found: dict[str, Any] = dict(group.attrs)
    for name, item in group.items():
        if name.startswith('#'):  # what MATLAB refers to
            continue
        if isinstance(item, h5py.Group):
            found[name] = _entries(item, h5py)
        elif isinstance(item, h5py.Dataset) and item.shape is not None:
            found[name] = item[()]
    return found


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    import h5py

    with h5py.File(path, 'w') as file:
        for name, column in columns.items():
            file[name] = column
