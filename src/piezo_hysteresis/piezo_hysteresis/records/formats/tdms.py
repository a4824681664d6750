"""TDMS of LabVIEW and NI: one table for each group; each channel has times of its own."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import meaning
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, column


def read(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each group; a channel without a unit in its name has that of the file."""
    import nptdms

    # it warns of a file that is cut off, which is refused here
    nptdms.log.log_manager.set_level(logging.ERROR)
    # opened as a file: by its name the index next to it would be read
    with path.open('rb') as opened, nptdms.TdmsFile.open(opened) as file:
        if file.file_status.incomplete_final_segment or not file.groups():
            raise RecordError('it ends before its last sample: it was cut off; save it again')
        groups = [(group.name, group.channels()) for group in file.groups()]
        sizes.judge(8 * sum(len(each) for _, channels in groups for each in channels))
        starts = [
            each.properties['wf_start_time'] for _, channels in groups for each in channels
            if isinstance(each.properties.get('wf_start_time'), np.datetime64)
        ]  # fmt: skip
        zero = min(starts, default=None)
        for name, channels in groups:
            columns = [found for each in channels if (found := _column(each, zero)) is not None]
            if columns:
                yield ColumnTable(name, columns)


def _column(channel: Any, zero: Any) -> Column | None:
    """Return a channel with its times: start time, start offset and increment."""
    found = column(_name(channel), channel[:])
    step = float(channel.properties.get('wf_increment', 0.0) or 0.0)
    if found is None or step <= 0.0 or (found.known or meaning(found.name)).what == 'time':
        return found
    start = float(channel.properties.get('wf_start_offset', 0.0))
    begins = channel.properties.get('wf_start_time')
    if isinstance(begins, np.datetime64) and zero is not None:
        start += float((begins - zero) / np.timedelta64(1, 'ns')) / 1e9
    return replace(found, time=np.asarray(start + step * np.arange(found.values.size), np.float64))


def _name(channel: Any) -> str:
    unit = str(channel.properties.get('unit_string', ''))
    if not unit or meaning(channel.name).unit:
        return str(channel.name)
    return f'{channel.name} ({unit})'


def write(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write one group; the time is a channel."""
    import nptdms

    time = columns['time_s']
    step, start = float(np.mean(np.diff(time))), float(time[0])
    channels = [
        nptdms.ChannelObject(
            'record',
            name,
            np.ascontiguousarray(values, np.float64),  # other kinds of array are garbled
            properties={'wf_increment': step, 'wf_start_offset': start, 'wf_samples': values.size},
        )
        for name, values in columns.items()
    ]
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)
