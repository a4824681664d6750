"""MATLAB: vectors and structs of ``.mat`` files, version 5 by SciPy and 7.3 by h5py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.formats import hdf5, sizes
from piezo_hysteresis.records.formats.column_table import ColumnTable, struct_tables


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a file: its vectors, and those of each struct."""
    from scipy.io import loadmat

    with path.open('rb') as file:
        new = b'MATLAB 7.3' in file.read(20)
    if new:
        yield from hdf5.read(path)
        return
    sizes.judge_matlab(path)
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        yield from hdf5.read(path)
        return
    entries = {key: value for key, value in content.items() if not key.startswith('__')}
    found = list(
        struct_tables({key: value for key, value in entries.items() if not _opaque(value)})
    )
    objects = [key for key, value in entries.items() if _opaque(value)]
    if not found and objects:
        raise hdf5.object_refused(objects)
    yield from found


def _opaque(value: Any) -> bool:
    """Return whether a value is a MATLAB object or a placeholder of one."""
    from scipy.io import matlab

    kinds = (matlab.MatlabOpaque, matlab.MatlabFunction)
    if isinstance(value, Mapping):
        return any(_opaque(each) for each in value.values())
    names = getattr(getattr(value, 'dtype', None), 'names', None) or ()
    return isinstance(value, kinds) or 's2' in names


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors, as columns."""
    from scipy.io import savemat

    savemat(path, columns, oned_as='column', appendmat=False)
