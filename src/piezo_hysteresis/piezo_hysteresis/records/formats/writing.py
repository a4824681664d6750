"""One interface for writing records in all formats."""

from __future__ import annotations

from pathlib import Path

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.formats.reading import FORMATS, missing
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import columns_of, new_file

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
