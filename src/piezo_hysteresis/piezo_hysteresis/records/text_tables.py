"""Tables of text files: any dialect, any decimal mark, quotes, dates; each cell counts."""

from __future__ import annotations

import codecs
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import Meaning, ReadOptions, stamped, used_columns
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.dialects import TextLayout, dialect_of, plain
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.table_reader import file_records
from piezo_hysteresis.records.text_cells import (
    decimal_mark,
    is_number,
    is_stamp,
    numbers,
    seconds,
    split,
)

#: Size from which it is worth importing pyarrow [byte].
LARGE = 4_000_000
# Characters of a large file that are searched for the column names.
_HEAD = 100_000


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


def text_tables(path: Path, log: DamageLog, options: ReadOptions) -> list[ColumnTable]:
    """Return the tables of a text file."""
    log, large = log.at(path), path.stat().st_size > LARGE
    lines = _lines(path, log, most=_HEAD if large else -1)
    layouts = _layouts(lines, path, options)
    if large and len(layouts) == 1 and _is_simple(layouts[0], lines):
        found = _at_once(path, layouts[0], options)
        if found is not None:
            return [found]
    if large:
        lines = _lines(path, log)
        layouts = _layouts(lines, path, options)
    tables: list[ColumnTable] = []
    for layout in layouts:
        tables += _tables(path, lines, layout, log, options)
    if len(tables) > 1 and not any(table.name for table in tables):
        tables = [replace(table, name=str(k)) for k, table in enumerate(tables, 1)]
    return tables


def _layouts(lines: Sequence[str], path: Path, options: ReadOptions) -> list[TextLayout]:
    if options.header_row is None:
        dialect = dialect_of(lines)
        if dialect is not None:
            try:
                return dialect.read(lines)
            except (StopIteration, IndexError, ValueError) as error:
                reason = str(error) or 'its header is cut off or changed'
                raise RecordError(f'{path}: it looks like a {dialect.name} but {reason}; give '
                                  'the line of the names with --header-row') from None  # fmt: skip
            except RecordError as error:
                raise RecordError(f'{path}: {dialect.name}: {error}') from None
    return [plain(lines, options.header_row, path)]


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
        log.guess('read as Windows-1252, since it is no UTF-8')
    return text.splitlines()


def _is_simple(layout: TextLayout, lines: Sequence[str]) -> bool:
    """Return whether plain numbers with decimal points follow, as far as the head shows."""
    body = ''.join(lines[layout.first : -1])
    commas = layout.separator != ',' and ',' in body
    return bool(layout.separator) and not (commas or '"' in body or layout.clock or layout.sparse)


def _at_once(path: Path, layout: TextLayout, options: ReadOptions) -> ColumnTable | None:
    """Return the columns of a large file that mean something; None if they are not all plain.

    Pyarrow reads in pieces and on all cores. 3 million rows of three columns: 0.9 s of processor
    time and 550 MB at the most, against 2.2 s and 850 MB by NumPy on lines of text, to the same
    bits. Files with comments or damage are left to the reader that reports the wrong line.
    """
    try:
        import pyarrow
        from pyarrow import csv
    except ImportError:
        return None
    timed = options.interval or layout.interval
    try:
        places = used_columns(layout.names, path, options, layout.known, timed)
    except RecordError:
        return None
    names = [f'f{place}' for place in places]
    try:
        table = csv.read_csv(
            path,
            csv.ReadOptions(skip_rows=layout.first, autogenerate_column_names=True),
            csv.ParseOptions(delimiter=layout.separator, quote_char=False),
            csv.ConvertOptions(
                column_types=dict.fromkeys(names, pyarrow.float64()),
                include_columns=names,
                null_values=[],
            ),
        )
    except (pyarrow.ArrowInvalid, pyarrow.ArrowKeyError):
        return None
    # copied: kernels are compiled anew for arrays that cannot be written
    taken = {place: np.array(table.column(f'f{place}').to_numpy()) for place in places}
    nothing = np.zeros(0)
    columns = [
        Column(name, taken.get(k, nothing), known=layout.known.get(k))
        for k, name in enumerate(layout.names)
    ]
    return _table(layout, columns)


def _table(
    layout: TextLayout, columns: list[Column], repeats: tuple[int, ...] = ()
) -> ColumnTable:
    notes = [layout.assumed] if layout.assumed else []
    if layout.head:
        notes.append(
            f'{counted(layout.head, "line")} in front of the column names not read, which may '
            'state units, factors or an interval'
        )
    if layout.names and all(name.isdigit() for name in layout.names) and not layout.assumed:
        notes.append('no line of names: its columns are 1, 2, 3, ...')
    return ColumnTable(
        layout.title, columns, layout.interval, layout.count, tuple(notes), repeats, layout.sparse
    )


def _tables(
    path: Path, lines: Sequence[str], layout: TextLayout, log: DamageLog, options: ReadOptions
) -> list[ColumnTable]:
    """Return the table of a layout, and those of other column names further down."""
    last = len(lines) if layout.last < 0 else layout.last
    rows: dict[int, list[str]] = {}  # cells by the number of their line, from 1
    repeats: list[int] = []
    below = None
    bare = [name.partition(' (')[0] for name in layout.names]
    for k in range(layout.first, last):
        line = lines[k]
        if not line.strip() or line.lstrip()[:1] == '#':
            continue
        cells = split(line, layout.separator)
        if _is_text(cells):
            if [cell.partition(' (')[0].strip('"\'') for cell in cells[: len(bare)]] == bare:
                repeats.append(len(rows))
                continue
            if len(cells) >= 2 and rows and _has_table(lines, k):
                below = replace(plain(lines, k + 1, ''), assumed='', last=last)
                break
        rows[k + 1] = cells
    if not rows:
        raise RecordError(f'{path}: it has column names but no samples; export it again')
    found = [_table(layout, _columns(path, rows, layout, log, options), tuple(repeats))]
    return [*found, *_tables(path, lines, below, log, options)] if below else found


def _is_text(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return len(filled) >= 2 and not any(is_number(c) or is_stamp(c) for c in filled)


def _has_table(lines: Sequence[str], k: int) -> bool:
    """Return whether a line of text within the numbers is one of column names."""
    cells = [cell for mark in ('\t', ';', ',') for cell in lines[k].split(mark)]
    return any(each in line.lower() for line in cells for each in ('time', 'zeit', 'volt', 'disp'))


def _columns(
    path: Path,
    rows: Mapping[int, list[str]],
    layout: TextLayout,
    log: DamageLog,
    options: ReadOptions,
) -> list[Column]:
    """Return the numbers of all columns; wrong rows and cells are damage.

    Only columns that mean something can be wrong: others are ignored.
    """
    hints = dict(layout.known)
    if layout.clock == 'sec_nanosec':
        hints |= {0: Meaning('time', 's', 1), 1: Meaning()}
    timed = options.interval or layout.interval
    try:
        places = sorted(used_columns(layout.names, path, options, hints, timed))
    except RecordError:
        places = []
    numbers_of, width = list(rows), max(len(layout.names), 1)
    wrong = {k: f'line {number} has {counted(len(cells), "cell")} for '
                f'{counted(width, "column")}'
             for k, (number, cells) in enumerate(rows.items())
             if any(cells[width:])}  # fmt: skip
    if len(wrong) > 0.5 * len(rows):
        raise RecordError(
            f'{path}: its rows have {counted(len(rows[numbers_of[0]]), "cell")} but '
            f'{counted(width, "column", "has")} a name; '
            'commas separate and stand in numbers, too, or names are missing: save it with '
            'semicolons, or name the line with --header-row'
        )
    cells = {k: [row[k] if k < len(row) else '' for row in rows.values()] for k in range(width)}
    mark = options.decimal or layout.decimal
    if not mark:
        chosen = places or list(cells)
        mark, grouped = decimal_mark((c for k in chosen for c in cells[k]), path)
        if grouped:
            other = '.' if mark == ',' else ','
            log.guess(f'{other!r} groups thousands, {mark!r} is the decimal mark')
    found = []
    for k, name in enumerate(layout.names):
        values, known = _values(cells[k], name, mark, path)
        if k in places and not layout.sparse:
            for row in np.flatnonzero(np.isnan(values)).tolist():
                cell = cells[k][row]
                if cell.lower() != 'nan':
                    complaint = f'line {numbers_of[row]} has {cell!r} in column {name}'
                    wrong.setdefault(row, complaint)
        found.append(Column(name, values, known=hints.get(k) or known))
    if layout.clock == 'index':
        start = float(layout.names[0].partition(' ')[2])
        found[0] = replace(found[0], values=start + layout.interval * found[0].values)
    if layout.clock == 'sec_nanosec':
        whole = found[0].values - found[0].values[0]
        found[0] = replace(found[0], values=whole + found[1].values / 1e9)
    if wrong:
        first = wrong[min(wrong)]
        many = len(wrong)
        what = f'{counted(many, "line")} cannot be read, {first}'
        log.add(what, count=many, lost=many, remedy='mend them')
        good = np.ones(len(rows), np.bool_)
        good[list(wrong)] = False
        found = [replace(each, values=each.values[good]) for each in found]
    return found


def _values(
    cells: Sequence[str], name: str, mark: str, path: Path
) -> tuple[FloatArray, Meaning | None]:
    """Return a column as numbers, and what it is if it holds dates."""
    dates = sum(map(is_stamp, cells[:50]))
    if dates and 2 * dates >= len(cells[:50]):
        return seconds(cells, path), stamped(name)
    return numbers(cells, mark), None
