"""HDF5, and MATLAB: version 7.3 is HDF5, version 5 is read by SciPy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import with_unit
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import ColumnTable, struct_tables


def read_hdf5(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each group with vectors; scalars may be data sets or attributes."""
    import h5py

    with h5py.File(path, 'r') as file:
        left: list[str] = []
        found = list(struct_tables(_entries(file, file, h5py, set(), left)))
        objects = [name for name in file if _is_object(file.get(name))]
    if not found and objects:
        raise object_refused(objects)
    note = f'{", ".join(left)} lies in another file and is not read' if left else ''
    if left and not found:
        raise RecordError(f'{note}; copy it into this one')
    yield from (replace(table, assumed=(*table.assumed, note)) if note else table
                for table in found)  # fmt: skip


def arrays(path: Path) -> dict[str, Any]:
    """Return the arrays at the top of a file by name, in the order of axes of their program."""
    import h5py

    with h5py.File(path, 'r') as file:
        found = _entries(file, file, h5py, set(), [])
        columns_first = any('MATLAB_class' in item.attrs for item in file.values())
    held = {
        name: each for name, each in found.items() if isinstance(each, np.ndarray | np.generic)
    }
    return {name: np.asarray(each).T if columns_first else np.asarray(each)
            for name, each in held.items()}  # fmt: skip


def object_refused(names: Sequence[str]) -> RecordError:
    """Return the error with the instruction to save objects that only MATLAB can read."""
    return RecordError(
        f'{", ".join(names)} is a MATLAB object (table, timetable, iddata), which only MATLAB '
        "reads; save its columns as vectors: save('x.mat', 'time_s', 'voltage_V', "
        "'displacement_um')"
    )


def _is_object(item: Any) -> bool:
    return item is not None and 'MATLAB_object_decode' in item.attrs


def _entries(file: Any, group: Any, h5py: Any, seen: set[Any], left: list[str]) -> dict[str, Any]:
    """Return the content of a group by name; what lies in other files is left out.

    A unit among the attributes of a data set stands behind its name.
    """
    found: dict[str, Any] = {key: group.attrs[key] for key in group.attrs}
    for name in group:
        link = group.get(name, getlink=True)
        if name.startswith('#'):  # what MATLAB refers to
            continue
        item = None if isinstance(link, h5py.ExternalLink) else group.get(name)
        if item is None:
            left.append(f'{group.name.rstrip("/")}/{name}')
        elif isinstance(item, h5py.Group):
            if item.id not in seen:
                seen.add(item.id)
                inner = _entries(file, item, h5py, seen, left)
                found[name] = _structs(file, item, inner, h5py)
        elif isinstance(item, h5py.Dataset) and item.shape is not None and not _is_object(item):
            if item.is_virtual or item.external:
                left.append(item.name)
                continue
            if item.dtype.kind in 'biufSUO' and item.dtype.names is None:
                sizes.judge(item.size * item.dtype.itemsize, item.name)
            found[_label(name, item.attrs)] = _value(item)
    return found


def _value(item: Any) -> Any:
    """Return the content of a data set; characters of MATLAB as text."""
    value = item[()]
    if _attribute(item.attrs, 'MATLAB_class') == 'char':
        return ''.join(map(chr, np.asarray(value).reshape(-1)))
    return value


def _label(name: str, attributes: Any) -> str:
    """Return the name of a data set with the unit of its attributes; PyMoDAQ has a label too."""
    unit = next((_attribute(attributes, key) for key in ('units', 'unit', 'Units') if
                 key in attributes), '')  # fmt: skip
    label = _attribute(attributes, 'label') if unit else ''
    return with_unit(label or name, unit)


def _attribute(attributes: Any, key: str) -> str:
    """Return an attribute as text; PyMoDAQ writes JSON."""
    value = attributes.get(key, '')
    text = value.decode('utf-8', 'replace') if isinstance(value, bytes) else str(value)
    return text.strip().strip('"') if text[:1] not in '[{' else ''


def _structs(file: Any, group: Any, entries: dict[str, Any], h5py: Any) -> Any:
    """Return an array of structs as a list: each field holds references to the values."""
    fields = {
        name: group[name][()].reshape(-1)
        for name in group
        if isinstance(group.get(name), h5py.Dataset)
        and h5py.check_ref_dtype(group[name].dtype) is h5py.Reference
    }
    if not fields or len({values.size for values in fields.values()}) != 1:
        return entries
    return [
        {name: _value(file[each]) for name, each in zip(fields, row, strict=True)
         if each and isinstance(file[each], h5py.Dataset)}
        for row in zip(*fields.values(), strict=True)
    ]  # fmt: skip


def write_hdf5(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    import h5py

    with h5py.File(path, 'w') as file:
        for name, column in columns.items():
            file[name] = column


def is_in_matlab(path: Path) -> bool:
    """Return whether a ``.mat`` file is HDF5."""
    with path.open('rb') as file:
        return b'MATLAB 7.3' in file.read(20)


def read_matlab(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a ``.mat`` file: its vectors, and those of each struct."""
    from scipy.io import loadmat

    if is_in_matlab(path):
        yield from read_hdf5(path)
        return
    sizes.judge_matlab(path)
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        yield from read_hdf5(path)
        return
    entries = {key: value for key, value in content.items() if not key.startswith('__')}
    found = list(
        struct_tables({key: value for key, value in entries.items() if not _opaque(value)})
    )
    objects = [key for key, value in entries.items() if _opaque(value)]
    if not found and objects:
        raise object_refused(objects)
    yield from found


def _opaque(value: Any) -> bool:
    """Return whether a value is a MATLAB object or a placeholder of one."""
    from scipy.io import matlab

    kinds = (matlab.MatlabOpaque, matlab.MatlabFunction)
    if isinstance(value, Mapping):
        return any(_opaque(each) for each in value.values())
    names = getattr(getattr(value, 'dtype', None), 'names', None) or ()
    return isinstance(value, kinds) or 's2' in names


def write_matlab(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors, as columns."""
    from scipy.io import savemat

    savemat(path, columns, oned_as='column', appendmat=False)
