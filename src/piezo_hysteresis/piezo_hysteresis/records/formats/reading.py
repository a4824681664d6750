"""One interface for files of columns in all binary formats, read and written as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.formats import columnar, excel, hdf5, instruments
from piezo_hysteresis.records.formats.column_table import ColumnTable
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import columns_of, new_file

Read = Callable[[Path], Iterable[ColumnTable]]
Write = Callable[[Path, dict[str, FloatArray]], None]
#: What reads the files of each ending, what writes them, and what they are called.
FORMATS: dict[str, tuple[Read, Write | None, str]] = {
    '.mat': (hdf5.read_matlab, hdf5.write_matlab, 'MATLAB file'),
    '.npz': (columnar.read_numpy, columnar.write_npz, 'NumPy archive'),
    '.npy': (columnar.read_numpy, None, 'NumPy array'),
    '.parquet': (columnar.read_arrow, columnar.write_arrow, 'Parquet file'),
    '.feather': (columnar.read_arrow, columnar.write_arrow, 'Feather file'),
    '.h5': (hdf5.read_hdf5, hdf5.write_hdf5, 'HDF5 file'),
    '.hdf5': (hdf5.read_hdf5, None, 'HDF5 file'),
    '.xlsx': (excel.read, excel.write, 'Excel file'),
    '.xlsm': (excel.read, None, 'Excel file'),
    '.tdms': (instruments.read_tdms, instruments.write_tdms, 'TDMS file'),
    '.mf4': (instruments.read_mdf, None, 'MDF file'),
    '.mdf': (instruments.read_mdf, None, 'MDF file'),
    '.uff': (instruments.read_uff, None, 'universal file'),
    '.unv': (instruments.read_uff, None, 'universal file'),
    '.ibw': (instruments.read_igor, None, 'Igor binary wave'),
}
# Libraries of few users, in an extra of their own.
_INSTRUMENTS = ('asammdf', 'pyuff', 'igor2')


def has_format(path: Path) -> bool:
    """Return whether a file is one of these, by its name."""
    return path.suffix.lower() in FORMATS


def tables(path: Path) -> list[ColumnTable]:
    """Return the tables of a file."""
    read, _, kind = FORMATS[path.suffix.lower()]
    try:
        return list(read(path))
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
    _, write, kind = FORMATS.get(path.suffix.lower(), (None, None, ''))
    if write is None:
        raise RecordError(f'{path}: end it in {", ".join(f".{each}" for each in WRITTEN)}')
    columns = columns_of(record, unit)
    try:
        with new_file(path) as temporary:
            write(temporary, columns)
    except ImportError as error:
        raise RecordError(missing(path, kind, error)) from None
