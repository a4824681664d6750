"""Records from and to CSV files with units in the column names."""

from __future__ import annotations

import io
from pathlib import Path

from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.table_reader import file_records
from piezo_hysteresis.records.tabular import columns_of, new_file
from piezo_hysteresis.records.text_tables import text_tables


def read_csv(path: str | Path, *, salvage: bool = False) -> Record:
    """Read one CSV file with the columns ``time_s, voltage_V, displacement_um``.

    Lengths may be in m, mm, um or nm, times in s, ms, us or ns; ``force_N`` may replace the
    voltage, ``reference_um`` may be added, further columns are ignored. Metadata from
    ``records.yaml`` next to the file (as `export` writes it) are used.

    Parameters
    ----------
    path : str or Path
        File with one line of column names.
    salvage : bool
        Return the longest intact part of a damaged file.

    Raises
    ------
    RecordError
        If the file is unusable.
    """
    log = DamageLog(salvage)
    path, options = Path(path), ReadOptions()
    return max(file_records(path, text_tables(path, log, options), log, options), key=len)


def write_csv(path: str | Path, record: Record, *, unit: str = 'um') -> None:
    """Write one record with the columns ``time_s, voltage_V, displacement_um``.

    Parameters
    ----------
    path : str or Path
        File to create.
    record : Record
        Record to write, with ``force_N`` if its input is a force, and the reference if it has one.
    unit : str
        Unit of the displacement: m, mm, um or nm.  In ``m`` every number is exact.

    Raises
    ------
    RecordError
        If the file exists or cannot be written; no partial file remains.
    """
    with new_file(Path(path)) as temporary:
        temporary.write_text(csv_text(record, unit=unit), 'utf-8')


def csv_text(record: Record, *, unit: str = 'um') -> str:
    """Return the content of the file that `write_csv` writes."""
    columns = columns_of(record, unit)
    text = io.StringIO()
    text.write(','.join(columns) + '\n')
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    text.writelines(f'{time:.12g},' + ','.join(map(repr, values)) + '\n' for time, *values in rows)
    return text.getvalue()
