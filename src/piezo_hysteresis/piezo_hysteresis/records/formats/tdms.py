"""TDMS of LabVIEW and NI: one table for each group; the increment of a channel gives the time."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import meaning
from piezo_hysteresis.records.formats.column_table import ColumnTable, tables_of


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each group; a channel without a unit in its name has that of the file.

    Raises
    ------
    RecordError
        If it was cut off, or its channels have two rates.
    """
    import nptdms

    # it warns of a file that is cut off, which is refused here
    nptdms.log.log_manager.set_level(logging.ERROR)
    with nptdms.TdmsFile.open(path) as file:
        if file.file_status.incomplete_final_segment or not file.groups():
            raise RecordError('it ends before its last sample: it was cut off; save it again')
        for group in file.groups():
            entries: dict[str, Any] = {_name(each): each[:] for each in group.channels()}
            steps = {float(each.properties.get('wf_increment', 0.0)) for each in group.channels()}
            if len(steps) > 1:
                raise RecordError(
                    f'the channels of group {group.name} have different increments: two rates are '
                    'no record; save those of one rate together'
                )
            entries['dt'] = max(steps, default=0.0)
            yield from tables_of(entries, group.name)


def _name(channel: Any) -> str:
    unit = str(channel.properties.get('unit_string', ''))
    if not unit or meaning(channel.name).unit:
        return str(channel.name)
    return f'{channel.name} ({unit})'


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write one group; the time is a channel."""
    import nptdms

    step = float(np.mean(np.diff(columns['time_s'])))
    channels = [
        nptdms.ChannelObject('record', name, column, properties={'wf_increment': step})
        for name, column in columns.items()
    ]
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)
