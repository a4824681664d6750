"""Universal file format (``.uff``, ``.unv``): the time responses of its data sets 58."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import with_unit
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable

_FUNCTION, _TIME_RESPONSE = 58, 1
# Lines in front of the numbers of a data set, and share of its lines that have one width.
_HEADER, _FIXED = 12, 0.9


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield one table: each time response is a channel with times of its own."""
    import pyuff

    _refuse_damage(path)
    file = pyuff.UFF(str(path))
    sets = [file.read_sets(int(k)) for k in np.flatnonzero(file.get_set_types() == _FUNCTION)]
    columns = [_column(each) for each in sets if each['func_type'] == _TIME_RESPONSE]
    if not columns:
        raise RecordError('it holds no time responses (data sets 58 of function type 1)')
    assumed = 'read as universal file: the name of a channel is the first ID line of its data set'
    yield ColumnTable('', columns, assumed=(assumed,))


def _refuse_damage(path: Path) -> None:
    """Refuse text whose numbers stand in lines of one width but for a few: digits are lost."""
    for part in (b'\n' + path.read_bytes()).split(b'\n    -1'):
        lines = part.strip(b'\r\n').split(b'\n')
        if lines[0].strip() != str(_FUNCTION).encode():
            continue
        widths = [len(line.rstrip()) for line in lines[_HEADER:-1]]
        usual = max(widths, key=widths.count, default=0)
        if _FIXED * len(widths) < widths.count(usual) < len(widths):
            raise RecordError('numbers stand in a line of another width; save it again')


def _column(found: dict[str, Any]) -> Column:
    name, values = str(found['id1']).strip(), np.asarray(found['data'])
    if values.size != found['num_pts'] or np.iscomplexobj(values):
        raise RecordError(f'{name!r} holds {values.size} numbers, its header states '
                          f'{found["num_pts"]} real ones; save it again')  # fmt: skip
    unit = str(found['ordinate_axis_units_lab'])
    time = np.asarray(found['x'], np.float64)
    return Column(with_unit(name, '' if unit.strip() == 'NONE' else unit), values, time)
