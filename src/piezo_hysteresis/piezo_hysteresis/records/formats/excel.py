"""Excel: one table for each sheet with a line of names above columns of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, time, timedelta
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import meaning, stamped, unit_known, with_unit
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, column
from piezo_hysteresis.records.text_cells import decimal_mark, is_number, is_stamp, numbers, seconds

Cells = Sequence[Any]


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each sheet; formulas count by the values that Excel stored."""
    import openpyxl

    sizes.judge_zip(path)
    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        for sheet in book.worksheets:
            columns = _columns(list(_rows(sheet)), sheet.title)
            if columns:
                yield ColumnTable(sheet.title, columns)
    finally:
        book.close()


def _rows(sheet: Any) -> Iterator[Cells]:
    """Yield the rows that hold something."""
    cells = (sheet.max_row or 0) * (sheet.max_column or 0)
    taken = 0
    if cells <= sizes.MOST_CELLS:
        for row in sheet.iter_rows(values_only=True):
            taken += len(row)
            if taken > sizes.MOST_CELLS:
                break
            if any(cell is not None for cell in row):
                yield row
    if max(cells, taken) > sizes.MOST_CELLS:
        raise RecordError(
            f'sheet {sheet.title!r} spans {sheet.max_row} rows of {sheet.max_column} cells, more '
            f'than {sizes.MOST_CELLS} cells; delete what lies far from the data'
        )


def _columns(rows: Sequence[Cells], sheet: str) -> list[Column]:
    """Return the columns below the line of names; words next to the numbers do not count."""
    head = _first_data(rows)
    if head is None:
        return []
    body, names = rows[head:], _names(rows, head)
    found = []
    for k in range(max(map(len, body))):
        cells = [row[k] if k < len(row) else None for row in body]
        name = names.get(k, '')
        if all(cell is None for cell in cells):
            if meaning(name).what:
                raise RecordError(
                    f'sheet {sheet!r}: column {name!r} has no values; formulas count by those '
                    'that Excel stored: open the file there and save it'
                )
            continue
        made = _column(name or str(k + 1), cells, sheet)
        if made is not None:
            found.append(made)
    return found


def _first_data(rows: Sequence[Cells]) -> int | None:
    """Return the first of three rows with numbers in the same two columns."""
    filled = [{k for k, cell in enumerate(row) if _is_value(cell)} for row in rows]
    for k in range(len(rows) - 1):
        if len(set.intersection(*filled[k : k + 3])) >= 2:
            return k
    return None


def _names(rows: Sequence[Cells], head: int) -> dict[int, str]:
    """Return the names of the columns, with units from a line between names and numbers."""
    above = [_texts(row) for row in rows[max(head - 2, 0) : head]]
    if not above:
        return {}
    last = above[-1]
    if len(above) == 2 and len(last) >= 1 and all(unit_known(text) for text in last.values()):
        return {k: with_unit(name, last.get(k, '')) for k, name in above[0].items()}
    return last


def _texts(row: Cells) -> dict[int, str]:
    return {k: str(cell) for k, cell in enumerate(row) if cell is not None}


def _is_value(cell: Any) -> bool:
    if isinstance(cell, str):
        return is_number(cell) or is_stamp(cell)
    return isinstance(cell, int | float | datetime | time | timedelta) and not isinstance(
        cell, bool
    )


def _column(name: str, cells: Cells, sheet: str) -> Column | None:
    """Return a column of numbers or times, NaN where there is none; None for text."""
    if any(isinstance(cell, time) for cell in cells):
        return Column(name, seconds([str(cell) for cell in cells], sheet), known=stamped(name))
    if any(isinstance(cell, datetime | timedelta) for cell in cells):
        return column(name, np.array(cells, object))
    texts = [cell for cell in cells if isinstance(cell, str)]
    if 2 * len(texts) <= len(cells):
        return Column(name, np.array([_number(cell) for cell in cells]))
    texts_of_cells = [str(cell) if cell is not None else '' for cell in cells]
    if sum(map(is_stamp, texts_of_cells)) > 0.5 * len(texts_of_cells):
        return Column(name, seconds(texts_of_cells, sheet), known=stamped(name))
    if sum(map(is_number, texts_of_cells)) < 0.5 * len(texts_of_cells):
        return None
    return Column(name, numbers(texts_of_cells, decimal_mark(texts, f'sheet {sheet!r}')[0]))


def _number(cell: Any) -> float:
    is_plain = isinstance(cell, int | float) and not isinstance(cell, bool)
    return float(cell) if is_plain else float('nan')


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write one sheet with a line of names."""
    import openpyxl

    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet('record')
    sheet.append(list(columns))
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        sheet.append(row)
    file = BytesIO()  # the archive of a full disk fails once more when it is collected
    book.save(file)
    path.write_bytes(file.getvalue())
