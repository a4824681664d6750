"""NumPy: ``.npz`` with named vectors, ``.npy`` with columns or fields."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import ColumnTable, tables_of


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a file; no code in it is executed."""
    if path.suffix.lower() == '.npz':
        sizes.judge_zip(path)
    loaded = np.load(path, mmap_mode='r', allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        sizes.judge(loaded.nbytes)
        yield from tables_of({path.stem: loaded})
        return
    with loaded:
        yield from tables_of({name: loaded[name] for name in loaded.files})


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    with path.open('wb') as file:
        np.savez(file, allow_pickle=False, **columns)
