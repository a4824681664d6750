"""Files of instruments: MDF, universal files, Igor binary waves, TDMS."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import UNITS, meaning, with_unit
from piezo_hysteresis.records.formats import sizes
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, column


def read_mdf(path: Path) -> Iterator[ColumnTable]:
    """Yield the channels of each group of ASAM MDF (``.mf4``), with the times of its master."""
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


_FUNCTION, _TIME_RESPONSE = 58, 1
# Universal files: lines in front of the numbers of a data set, share of those of one width.
_LINES_ABOVE, _FIXED = 12, 0.9


def read_uff(path: Path) -> Iterator[ColumnTable]:
    """Yield the time responses of data sets 58, channels with times of their own."""
    import pyuff

    _refuse_uff(path)
    file = pyuff.UFF(str(path))
    sets = [file.read_sets(int(k)) for k in np.flatnonzero(file.get_set_types() == _FUNCTION)]
    columns = [_uff_column(each) for each in sets if each['func_type'] == _TIME_RESPONSE]
    if not columns:
        raise RecordError('it holds no time responses (data sets 58 of function type 1)')
    assumed = 'read as universal file: the name of a channel is the first ID line of its data set'
    yield ColumnTable('', columns, assumed=(assumed,))


def _refuse_uff(path: Path) -> None:
    """Refuse text whose numbers stand in lines of one width but for a few: digits are lost."""
    for part in (b'\n' + path.read_bytes()).split(b'\n    -1'):
        lines = part.strip(b'\r\n').split(b'\n')
        if lines[0].strip() != str(_FUNCTION).encode():
            continue
        widths = [len(line.rstrip()) for line in lines[_LINES_ABOVE:-1]]
        usual = max(widths, key=widths.count, default=0)
        if _FIXED * len(widths) < widths.count(usual) < len(widths):
            raise RecordError('numbers stand in a line of another width; save it again')


def _uff_column(found: dict[str, Any]) -> Column:
    name, values = str(found['id1']).strip(), np.asarray(found['data'])
    if values.size != found['num_pts'] or np.iscomplexobj(values):
        raise RecordError(f'{name!r} holds {values.size} numbers, its header states '
                          f'{found["num_pts"]} real ones; save it again')  # fmt: skip
    unit = str(found['ordinate_axis_units_lab'])
    time = np.asarray(found['x'], np.float64)
    return Column(with_unit(name, '' if unit.strip() == 'NONE' else unit), values, time)


# Igor, version 5: bytes that its checksum covers, and of the part in front of the wave.
_VERSION, _HEADER, _PARTS = 5, 384, 64


def read_igor(path: Path) -> Iterator[ColumnTable]:
    """Yield the columns of a wave (``.ibw``), by their dimension labels or numbers."""
    from igor2 import binarywave

    sizes.judge(path.stat().st_size)
    logging.getLogger('igor2').setLevel(logging.CRITICAL)  # it prints the bytes of a damaged file
    _refuse_igor(path)
    wave = binarywave.load(str(path))['wave']
    values, header = np.asarray(wave['wData']), wave['wave_header']
    if values.ndim != 2:
        raise RecordError(
            f'its wave has {values.ndim} dimension(s); save voltage and displacement as the '
            'columns of one wave'
        )
    labels = [_text(each) for each in wave['labels'][1][1:]]
    names = [each or str(k) for k, each in enumerate([*labels, *[''] * values.shape[1]], 1)]
    found = [column(name, each) for name, each in zip(names, values.T, strict=False)]
    columns = [each for each in found if each is not None]
    unit, step = _text(b''.join(np.ravel(header['dimUnits'][0]))), float(header['sfA'][0])
    interval = step / UNITS['time'][unit] if unit in UNITS['time'] else 0.0
    assumed = ('read as Igor wave: rows are the row scaling apart where that is in seconds',)
    yield ColumnTable('', columns, interval, assumed=assumed)


def _refuse_igor(path: Path) -> None:
    """Refuse a wave of version 5 whose header or length is not as it was written."""
    with path.open('rb') as file:
        header = file.read(_HEADER)
    order = '<' if header[:1] == b'\x05' else '>'
    if len(header) < _HEADER or struct.unpack_from(f'{order}h', header)[0] != _VERSION:
        return
    if sum(struct.unpack(f'{order}{_HEADER // 2}h', header)) & 0xFFFF:
        raise RecordError('the checksum of its header is wrong; save it again')
    stated = _PARTS + sum(struct.unpack_from(f'{order}13i', header, 4))
    if path.stat().st_size > stated:
        raise RecordError(f'it is longer than the {stated} bytes that it states; save it again')


def _text(raw: Any) -> str:
    return bytes(raw).split(b'\0')[0].decode('utf-8', 'replace').strip()


def read_tdms(path: Path) -> Iterator[ColumnTable]:
    """Yield a table for each group of TDMS; a channel without a unit has that of the file."""
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
            columns = [
                found for each in channels if (found := _tdms_column(each, zero)) is not None
            ]
            if columns:
                yield ColumnTable(name, columns)


def _tdms_column(channel: Any, zero: Any) -> Column | None:
    """Return a channel with its times: start time, start offset and increment."""
    found = column(_tdms_name(channel), channel[:])
    step = float(channel.properties.get('wf_increment', 0.0) or 0.0)
    if found is None or step <= 0.0 or (found.known or meaning(found.name)).what == 'time':
        return found
    start = float(channel.properties.get('wf_start_offset', 0.0))
    begins = channel.properties.get('wf_start_time')
    if isinstance(begins, np.datetime64) and zero is not None:
        start += float((begins - zero) / np.timedelta64(1, 'ns')) / 1e9
    return replace(found, time=np.asarray(start + step * np.arange(found.values.size), np.float64))


def _tdms_name(channel: Any) -> str:
    unit = str(channel.properties.get('unit_string', ''))
    if not unit or meaning(channel.name).unit:
        return str(channel.name)
    return f'{channel.name} ({unit})'


def write_tdms(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write one group of TDMS; the time is a channel."""
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
