"""MDF of test benches and vehicles (ASAM, ``.mf4``): one table for each group of channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, column


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield the channels of each group, in physical values; each has the times of its master."""
    from asammdf import MDF

    found: dict[int, list[Column]] = {}
    with MDF(str(path)) as file:
        sizes.judge(8 * sum(g.channel_group.cycles_nr * len(g.channels) for g in file.groups))
        for signal in file.iter_channels():
            each = column(signal.name, signal.samples, signal.unit or '')
            if each is not None:
                time = np.asarray(signal.timestamps, np.float64)
                found.setdefault(signal.group_index, []).append(replace(each, time=time))
    assumed = ('read as MDF: physical values at the times of the master channel of each group',)
    for group, columns in found.items():
        yield ColumnTable(f'group_{group + 1}', columns, assumed=assumed)
