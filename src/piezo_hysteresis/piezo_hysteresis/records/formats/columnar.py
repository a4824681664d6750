"""NumPy (``.npz``, ``.npy``), and Parquet and Feather by pyarrow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import ColumnTable, tables_of


def arrays(path: Path) -> dict[str, Any]:
    """Return the arrays of a file by name; no code in it is executed."""
    if path.suffix.lower() == '.npz':
        sizes.judge_zip(path)
    loaded = np.load(path, mmap_mode='r', allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        sizes.judge(loaded.nbytes)
        return {path.stem: loaded}
    with loaded:
        return {name: loaded[name] for name in loaded.files}


def read_numpy(path: Path) -> Iterator[ColumnTable]:
    """Yield the tables of a file."""
    yield from tables_of(arrays(path))


def write_npz(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    with path.open('wb') as file:
        np.savez(file, allow_pickle=False, **columns)


def read_arrow(path: Path) -> Iterator[ColumnTable]:
    """Yield the table of a file; a missing value is NaN."""
    if path.suffix.lower() == '.feather':
        from pyarrow import feather

        table = feather.read_table(path)
    else:
        from pyarrow import parquet

        # as a file: a path would be taken for a data set, with columns by the names of folders
        with path.open('rb') as file:
            opened = parquet.ParquetFile(file)
            sizes.judge(8 * opened.metadata.num_rows * opened.metadata.num_columns)
            table = opened.read()
    yield from tables_of({name: table.column(name).to_numpy() for name in table.column_names})


def write_arrow(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write named vectors."""
    import pyarrow
    from pyarrow import feather, parquet

    table = pyarrow.table({name: np.ascontiguousarray(v) for name, v in columns.items()})
    if '.feather' in path.suffixes:  # under another name until the file is complete
        feather.write_feather(table, path)
    else:
        parquet.write_table(table, path)
