"""Files of other measurement programs, each by the library that reads it: MDF4, UFF58, Igor."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.records.columns import Meaning, with_unit
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, vector

MDF_RULE = 'read as MDF: each channel has the times of its group'
UFF58_RULE = 'read as UFF58: even times from the increment of each set'
IGOR_RULE = 'read as Igor binary wave: the scale of its rows is the time in s'


class _Mdf:
    """MDF 3 and 4: every channel with the times of its group."""

    @staticmethod
    def read(path: Path) -> Iterator[ColumnTable]:
        """Yield one table with the channels of all groups."""
        import asammdf

        with asammdf.MDF(path) as file:
            sizes.judge(sum(16 * group.channel_group.cycles_nr * len(group.channels)
                            for group in file.groups))  # fmt: skip
            columns = [
                Column(with_unit(signal.name, signal.unit or ''), values,
                       np.asarray(signal.timestamps, np.float64))
                for signal in file.iter_channels(skip_master=True)
                if (values := vector(signal.samples)) is not None
            ]  # fmt: skip
        yield ColumnTable('', columns, assumed=(MDF_RULE,))  # fmt: skip


class _Uff:
    """Universal file format, sets of type 58: one channel each."""

    @staticmethod
    def read(path: Path) -> Iterator[ColumnTable]:
        """Yield one table with the time responses of all sets."""
        import pyuff

        file = pyuff.UFF(str(path))
        kinds = list(file.get_set_types())
        columns: list[Column] = []
        for k, kind in enumerate(kinds):
            if int(kind) != 58:
                continue
            each: dict[str, Any] = file.read_sets(k)
            values = vector(each['data'])
            if values is None or int(each.get('func_type', 1)) not in (0, 1):
                continue
            name = str(each.get('id1') or '').strip()
            name = name if name and name != 'NONE' else str(len(columns) + 1)
            unit = str(each.get('ordinate_axis_units_lab') or '').strip()
            columns.append(Column(with_unit(name, '' if unit == 'NONE' else unit), values,
                                  _uff_time(each, values.size)))  # fmt: skip
        yield ColumnTable('', columns, assumed=(UFF58_RULE,))  # fmt: skip


def _uff_time(each: dict[str, Any], size: int) -> Any:
    """Return the times of a set: written ones have six digits, the increment has all."""
    step = float(each.get('abscissa_inc') or 0.0)
    if int(each.get('abscissa_spacing', 1)) == 1 and step > 0.0:
        return float(each.get('abscissa_min') or 0.0) + step * np.arange(size)
    return np.asarray(each['x'], np.float64)


class _Igor:
    """Igor binary wave: columns by the labels of their dimension."""

    @staticmethod
    def read(path: Path) -> Iterator[ColumnTable]:
        """Yield the columns of a wave of two dimensions; the scale of the rows is the time."""
        from igor2 import binarywave

        wave = binarywave.load(str(path))['wave']
        header = wave['wave_header']
        data = np.asarray(wave['wData'])
        sizes.judge(8 * data.size)
        rows = data.reshape(data.shape[0], -1)
        step, start = (float(np.ravel(header[key])[0]) for key in ('sfA', 'sfB'))
        labels = [label.decode() for label in wave.get('labels', [[], []])[1] if label]
        names = labels if len(labels) == rows.shape[1] else [
            str(k + 1) for k in range(rows.shape[1])
        ]  # fmt: skip
        unit = b''.join(np.ravel(header.get('dataUnits', b''))).decode('latin-1').strip('\0')
        columns = [Column('x scale', np.asarray(start + step * np.arange(len(rows)), np.float64),
                          known=Meaning('time', 's', 1))]  # fmt: skip
        columns += [Column(with_unit(name, unit), np.asarray(rows[:, k], np.float64))
                    for k, name in enumerate(names)]  # fmt: skip
        yield ColumnTable('', columns, assumed=(IGOR_RULE,))  # fmt: skip


MDF, UFF, IGOR = _Mdf(), _Uff(), _Igor()
