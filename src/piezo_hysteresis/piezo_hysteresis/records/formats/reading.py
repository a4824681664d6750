"""One interface for files of columns in all formats: a file becomes records."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import assigned, renamed
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.formats import (
    arrow,
    excel,
    hdf5,
    matlab,
    numpy_files,
    tdms,
)
from piezo_hysteresis.records.formats.column_table import ColumnTable
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import in_si, records_from

#: Module of each ending, and what its files are called.
FORMATS = {
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
}


def has_format(path: Path) -> bool:
    """Return whether a file is one of these, by its name."""
    return path.suffix.lower() in FORMATS


def tables(path: Path) -> list[ColumnTable]:
    """Return the tables of a file.

    Raises
    ------
    RecordError
        If a library is missing, or the file cannot be read.
    """
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
    return f"{path}: a {kind} needs {error.name}; pip install 'piezo_hysteresis[formats]'"


def table_records(
    path: Path, log: DamageLog, chosen: Mapping[str, str] | None = None
) -> list[Record]:
    """Return the records of a file: one for each table with the required columns.

    Parameters
    ----------
    path : Path
        File of one of `FORMATS`.
    log : DamageLog
        Lists or raises damage.
    chosen : mapping of str to str, optional
        Columns by quantity, as in `csv_files.csv_records`.

    Raises
    ------
    RecordError
        If the file is unusable, or none of its tables has the required columns.
    """
    found = tables(path)
    if not found:
        raise RecordError(f'{path}: it holds no columns of numbers; save time, voltage and '
                          'displacement as vectors')  # fmt: skip
    records: list[Record] = []
    reasons: list[RecordError] = []
    for table in found:
        try:
            records += _of_table(path, table, log, chosen or {}, len(found) > 1)
        except RecordError as error:
            reasons.append(error)
    if not records:
        raise reasons[0]
    for reason in reasons:
        log.note(path, f'left out: {reason}')
    return records


def _of_table(
    path: Path, table: ColumnTable, log: DamageLog, chosen: Mapping[str, str], is_part: bool
) -> list[Record]:
    where = f'{path} ({table.name})' if is_part and table.name else str(path)
    names = list(table.columns)
    meanings, guessed = assigned(renamed(names, chosen, where), where)
    if guessed:
        log.guess(path, f'reading {guessed}')
    columns = dict(enumerate(table.columns.values()))
    return records_from(path, in_si(columns, meanings), log, table.name if is_part else '')
