"""One interface for files of columns in all binary formats, read and written as tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.formats import (
    arrow,
    excel,
    hdf5,
    igor,
    matlab,
    mdf,
    numpy_files,
    tdms,
    uff,
)
from piezo_hysteresis.records.formats.column_table import ColumnTable
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import columns_of, new_file

#: Module of each ending, and what its files are called.
FORMATS: dict[str, tuple[Any, str]] = {
    '.mat': (matlab, 'MATLAB file'),
    '.npz': (numpy_files, 'NumPy archive'),
    '.npy': (numpy_files, 'NumPy array'),
    '.parquet': (arrow, 'Parquet file'),
    '.feather': (arrow, 'Feather file'),
    '.h5': (hdf5, 'HDF5 file'),
    '.hdf5': (hdf5, 'HDF5 file'),
    '.xlsx': (excel, 'Excel file'),
    '.xlsm': (excel, 'Excel file'),
    '.tdms': (tdms, 'TDMS file'),
    '.mf4': (mdf, 'MDF file'),
    '.mdf': (mdf, 'MDF file'),
    '.uff': (uff, 'universal file'),
    '.unv': (uff, 'universal file'),
    '.ibw': (igor, 'Igor binary wave'),
}
# Libraries of few users, in an extra of their own.
_INSTRUMENTS = ('asammdf', 'pyuff', 'igor2')


def has_format(path: Path) -> bool:
    """Return whether a file is one of these, by its name."""
    return path.suffix.lower() in FORMATS


def tables(path: Path) -> list[ColumnTable]:
    """Return the tables of a file."""
    reader, kind = FORMATS[path.suffix.lower()]
    try:
        return list(reader.read(path))
    except RecordError as error:
        raise RecordError(f'{path}: {error}') from None
    except ImportError as error:
        raise RecordError(missing(path, kind, error)) from None
    except MemoryError:
        raise
    except Exception as error:  # libraries raise any exception for truncated or damaged files
        reason = ' '.join(str(error).split())[:120] or type(error).__name__
        raise RecordError(f'{path}: it is no readable {kind} ({reason}); save it again') from None


def missing(path: Path, kind: str, error: ImportError) -> str:
    """Return the message with the library that a format needs."""
    extra = 'instruments' if error.name in _INSTRUMENTS else 'formats'
    return f"{path}: a {kind} needs {error.name}; pip install 'piezo_hysteresis[{extra}]'"


#: Endings that can be written, without the dot.
WRITTEN = ('mat', 'npz', 'h5', 'parquet', 'feather', 'tdms', 'xlsx')


def write_table(path: str | Path, record: Record, *, unit: str = 'um') -> None:
    """Write one record as named columns, in the format of the ending."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending.removeprefix('.') not in WRITTEN:
        raise RecordError(f'{path}: end it in {", ".join(f".{each}" for each in WRITTEN)}')
    writer, kind = FORMATS[ending]
    columns = columns_of(record, unit)
    try:
        with new_file(path) as temporary:
            writer.write(temporary, columns)
    except ImportError as error:
        raise RecordError(missing(path, kind, error)) from None
