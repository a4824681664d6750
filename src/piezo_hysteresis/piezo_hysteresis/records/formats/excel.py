"""Excel: one table for each sheet with a line of names above columns of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.formats.column_table import ColumnTable, tables_of


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each sheet; formulas count by the values that Excel stored."""
    import openpyxl

    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        for sheet in book.worksheets:
            yield from tables_of(_columns(list(sheet.iter_rows(values_only=True))), sheet.title)
    finally:
        book.close()


def _columns(rows: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Return the columns below the last line of names; an empty cell is NaN."""
    head = next((k for k, row in enumerate(rows) if _is_data(row)), 0)
    names = list(rows[head - 1]) if head else []
    body = [row for row in rows[head:] if any(cell is not None for cell in row)]
    found: dict[str, Any] = {}
    for k in range(max(map(len, body), default=0)):
        cells = [row[k] if k < len(row) else None for row in body]
        given = names[k] if k < len(names) else None
        name = str(k + 1) if given is None else str(given)
        if any(isinstance(cell, datetime | time) for cell in cells):
            found[name] = np.array([_moment(cell) for cell in cells], 'datetime64[us]')
        elif any(_is_number(cell) for cell in cells):
            found[name] = np.array([_number(cell) for cell in cells])
    return found


def _number(cell: Any) -> float:
    return float(cell) if _is_number(cell) else float('nan')


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _is_data(row: Sequence[Any]) -> bool:
    filled = [cell for cell in row if cell is not None]
    return len(filled) >= 2 and not any(isinstance(cell, str) for cell in filled)


def _moment(cell: Any) -> Any:
    if isinstance(cell, time):
        return datetime.combine(datetime(2000, 1, 1), cell)
    return cell if isinstance(cell, datetime) else None


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write one sheet with a line of names."""
    import openpyxl

    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet('record')
    sheet.append(list(columns))
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        sheet.append(row)
    book.save(path)
