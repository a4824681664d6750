"""Records from and to CSV files with units in the column names."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import csv_columns
from piezo_hysteresis.records.columns import EXAMPLE, assigned, renamed
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import columns_of, in_si, new_file, records_from

END_OF_HEADER = '***End_of_Header***'  # LabVIEW


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
    records = csv_records(Path(path), log)
    return max(records, key=len)


def csv_records(
    path: Path,
    log: DamageLog,
    chosen: Mapping[str, str] | None = None,
    header_row: int | None = None,
) -> list[Record]:
    """Return a CSV file as one record, or as its intact parts when salvaging.

    Parameters
    ----------
    path : Path
        File with one line of column names.
    log : DamageLog
        Lists or raises damage.
    chosen : mapping of str to str, optional
        ``NAME:UNIT`` or the number of a column, from 1, by quantity; other columns are assigned by
        their names.
    header_row : int, optional
        Line of the column names, from 1; by default the first one that is neither empty nor a
        comment, after a header block of LabVIEW.

    Raises
    ------
    RecordError
        If the file is unusable and the log does not salvage, or no part of it is readable.
    """
    values, meanings = _table(path, log, chosen or {}, header_row)
    if not values.size:
        raise RecordError(f'{path}: it has column names but no samples; export it again')
    by_place = dict(zip(meanings, values.T, strict=True))
    return records_from(path, in_si(by_place, meanings), log)


def _table(
    path: Path, log: DamageLog, chosen: Mapping[str, str], header_row: int | None
) -> tuple[FloatArray, dict[int, tuple[str, str]]]:
    """Return the numbers of the columns that mean something, shape (n, columns), and what."""
    large = path.stat().st_size > csv_columns.LARGE
    lines = _lines(path, log, most=_HEAD if large else -1)
    first = _first(lines, header_row, path)
    delimiter = _delimiter(lines[first])
    names = _names(lines, first, delimiter)
    numbers = all(map(_is_number, names))  # the first line is one of numbers: none has a name
    if numbers:
        names = [str(k) for k in range(1, len(names) + 1)]
    meanings, guessed = assigned(renamed(names, chosen, path), path)
    if guessed:
        log.guess(path, f'reading {guessed}')
    head = first - 1 if numbers else first
    commas = delimiter != ',' and ',' in ''.join(lines[head + 1 : head + 2])
    plain = large and delimiter and not commas
    values = csv_columns.columns(path, head, delimiter, list(meanings)) if plain else None
    if values is None:
        lines = _lines(path, log) if large else lines
        values = _values(path, lines, head, delimiter, names, meanings, log)
    return values, meanings


# Characters of a large file that are searched for the column names.
_HEAD = 100_000


def _lines(path: Path, log: DamageLog, most: int = -1) -> list[str]:
    """Return the lines of a file in UTF-8, UTF-16 (with its mark) or Windows-1252."""
    with path.open('rb') as file:
        data = file.read(most)
    wide = data[:2] in (b'\xff\xfe', b'\xfe\xff')
    text = None
    for encoding in ('utf-16',) if wide else ('utf-8-sig', 'cp1252'):
        try:  # the last character of a piece may be cut
            text = codecs.getincrementaldecoder(encoding)().decode(data, most < 0)
            break
        except UnicodeDecodeError:
            continue
    head = (text or '')[:_HEAD]
    letters = sum('\t' <= letter < '\x7f' for letter in head)
    if text is None or any(letter < '\t' for letter in head) or 2 * letters < len(head):
        raise RecordError(f'{path} is not a text file; save it as CSV in UTF-8')
    if encoding == 'cp1252':
        log.guess(path, 'read as Windows-1252, since it is no UTF-8')
    return text.splitlines()


def _first(lines: list[str], header_row: int | None, path: Path) -> int:
    """Return the place of the line with the column names."""
    begin = 0
    if header_row is not None:
        if not 1 <= header_row <= len(lines):
            raise RecordError(f'{path}: it has no line {header_row}, but {len(lines)} lines')
        begin = header_row - 1
    else:
        marks = [k for k, line in enumerate(lines) if line.startswith(END_OF_HEADER)]
        begin = marks[-1] + 1 if marks else 0
    filled = (k for k in range(begin, len(lines)) if lines[k].strip() and lines[k][0] != '#')
    first = next(filled, None)
    if first is None:
        raise RecordError(f'{path}: the file is empty; it needs the columns {EXAMPLE}')
    return first


def _delimiter(line: str) -> str:
    """Return what separates the columns; empty for spaces."""
    found = next((mark for mark in ('\t', ';', ',') if mark in line), '')
    return found or ('' if len(line.split()) > 1 else ',')


def _names(lines: list[str], first: int, delimiter: str) -> list[str]:
    """Return the names of the columns; words count as names if their number matches."""
    line = lines[first].strip() if not delimiter else lines[first]
    names = line.split(delimiter or None)
    if not delimiter and first + 1 < len(lines) and len(lines[first + 1].split()) != len(names):
        names = re.split(r'\s{2,}', line)
    return [name.strip().strip('"\'') for name in names]


def _is_number(text: str) -> bool:
    try:
        float(text.replace(',', '.'))
    except ValueError:
        return False
    return True


def _values(
    path: Path,
    lines: list[str],
    head: int,
    delimiter: str,
    names: list[str],
    meanings: dict[int, tuple[str, str]],
    log: DamageLog,
) -> FloatArray:
    """Return the numbers of the columns that mean something, shape (n, columns)."""
    body = lines[head + 1 :]
    if delimiter != ',' and any(',' in line for line in body[:1]):
        body = [line.replace(',', '.') for line in body]
    options: dict[str, Any] = {
        'delimiter': delimiter or None,
        'usecols': list(meanings),
        'ndmin': 2,
    }
    if all(not line.strip() or line.lstrip().startswith('#') for line in body):
        return np.zeros((0, len(meanings)))
    try:
        return np.asarray(np.loadtxt(body, **options))
    except ValueError:
        return _slowly(path, body, head, delimiter, names, meanings, log)


def _slowly(
    path: Path,
    body: list[str],
    head: int,
    delimiter: str,
    names: list[str],
    meanings: dict[int, tuple[str, str]],
    log: DamageLog,
) -> FloatArray:
    """Read line by line, to report wrong lines and to keep the others."""
    rows, wrong, first = [], 0, ''
    for number, line in enumerate(body, start=head + 2):
        if not line.strip() or line.startswith('#'):
            continue
        cells = line.split(delimiter or None)
        row = []
        for place in meanings:
            cell = cells[place].strip().strip('"') if place < len(cells) else ''
            try:
                row.append(float(cell))
            except ValueError:
                first = first or f'line {number} has {cell!r} in column {names[place]}'
        if len(row) == len(meanings):
            rows.append(row)
        else:
            wrong += 1
    if wrong:
        log.add(path, f'{wrong} lines are not numbers, {first}', count=wrong, lost=wrong,
                remedy='mend them')  # fmt: skip
    return np.array(rows).reshape(-1, len(meanings))


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
