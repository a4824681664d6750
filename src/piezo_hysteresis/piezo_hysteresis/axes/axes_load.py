"""Records of several axes from tables, arrays, pairs of files and bags."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord, leveled
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.array_pairs import ArrayPair, file_pairs, folder_pairs
from piezo_hysteresis.records.bag_content import BagContent
from piezo_hysteresis.records.bags import axes_tracks
from piezo_hysteresis.records.columns import UNITS, ReadOptions, counted_axes, pattern_of
from piezo_hysteresis.records.damage import DamageLog, read_advised
from piezo_hysteresis.records.formats.column_table import ColumnTable
from piezo_hysteresis.records.frames import DataFrameLike, columns_in
from piezo_hysteresis.records.load import (
    Reading,
    content_of,
    interval,
    matching,
    tables_of_file,
    uniquely_named,
    warn_of,
)
from piezo_hysteresis.records.sampling import Track, check_units, sampled
from piezo_hysteresis.records.table_reader import file_samples, track_of


def load_axes(
    source: Any,
    *more: Any,
    axes: int | None = None,
    fs: float | None = None,
    dt: float | None = None,
    voltage: str = '',
    displacement: str = '',
    periodic: bool | int | None = None,
    sign: float = 1.0,
    unit: str = '',
    salvage: bool = False,
) -> list[AxesRecord]:
    """Return records of several axes from files, folders, bags, arrays or data frames.

    Parameters
    ----------
    source, *more : path, arrays, mapping, data frame, AxesRecord, or list of them
        Files of columns ``voltage_1_V, voltage_2_V, ..., displacement_1_um, ...``; bags with a
        topic ``actuator/state`` in a namespace an axis, on one clock; arrays ``(u, y)`` of shape
        (sample, channel), (sample, channel, realisation) or (sample, channel, realisation,
        period), in V and m; files of such arrays, ``u`` with ``y`` or, in a folder,
        ``u_100mV.npy`` with ``y_100mV.npy``. Each realisation is one record, its periods follow
        each other.
    axes : int, optional
        Number of voltages that the data must have.
    fs, dt : float, optional
        Sampling rate [Hz] or interval [s] of data without a time; of a file, its time is then not
        used.
    voltage, displacement : str
        Patterns of the columns, arrays or files, such as ``'u*'`` or ``'u*:mV'``; channels are
        taken in the order of the numbers in their names.
    periodic : bool or int, optional
        The records are of a steady state: True for one whole period, a number for as many. An
        array with an axis of periods states it.
    sign : float
        -1 for sensors that measure the distance.
    unit : str
        Unit of displacements that state none.
    salvage : bool
        Return the readable part of damaged data.

    Returns
    -------
    list of AxesRecord
        With unique names. Their level is stated by their name (``100mV``), or found from the RMS
        voltage.

    Raises
    ------
    RecordError
        If the data are unusable, have another number of axes, or differ in channels or rate.
    """
    given = [source, *more] if more else _several(source)
    columns = {k: v for k, v in (('voltage', voltage), ('displacement', displacement)) if v}
    options = ReadOptions(columns, interval=interval(dt, fs), sign=sign, unit=unit, axes=True)
    reading = AxesReading(DamageLog(salvage), options, periodic=periodic)
    records = reading.records(given, axes)
    warn_of(reading.log)
    return records


def _several(source: Any) -> list[Any]:
    """Return one source or several as a list; a pair of arrays is one."""
    if isinstance(source, list) and not _is_pair(source):
        return source
    return [source]


def _is_pair(given: Any) -> bool:
    return (
        isinstance(given, (tuple, list))
        and len(given) == 2
        and all(isinstance(each, np.ndarray) and each.ndim for each in given)
    )


@dataclass(frozen=True)
class AxesReading(Reading[AxesRecord]):
    """Reads everything as records of several axes; `periodic` is that of `load_axes`."""

    periodic: bool | int | None = field(default=None, kw_only=True)

    def records(self, sources: Sequence[Any], axes: int | None = None) -> list[AxesRecord]:
        """Return the records of all sources, of the same channels and rate.

        Raises
        ------
        RecordError
            As `load_axes` does.
        """
        return read_advised(lambda log: replace(self, log=log)._records(sources, axes), self.log)

    def _records(self, sources: Sequence[Any], axes: int | None) -> list[AxesRecord]:
        found: list[AxesRecord] = []
        for given in sources:
            found += self._of_source(given)
        if not found:
            raise RecordError('no data were given; name a folder, a bag or a file of columns')
        if self.options.sign < 0:
            found = [replace(each, displacement=-each.displacement) for each in found]
        found = uniquely_named(found)
        _require_alike(found, axes)
        return leveled(found)

    def _of_source(self, given: Any) -> list[AxesRecord]:
        if isinstance(given, AxesRecord):
            return [given]
        if isinstance(given, (str, Path)):
            return [record for path in matching(given) for record in self.of_path(path)]
        if isinstance(given, Mapping) and {*given} == {'voltage', 'displacement'}:
            given = given['voltage'], given['displacement']
        if isinstance(given, (tuple, list)) and len(given) == 2:
            return self._of_pair(ArrayPair('record', ('voltage', 'displacement'), *given))
        if isinstance(given, (Mapping, DataFrameLike)):
            table, log = ColumnTable('', columns_in(given)), self.log.at('the data')
            track = track_of(table, 'record', log, self.options, of_file=False)
            return [self._record(each) for each in sampled(track, log)]
        raise RecordError(
            'data of several axes are a path, arrays (voltages, displacements) with fs, a data '
            f'frame, or a list of them, not of type {type(given).__name__}'
        )

    def of_bag(self, content: BagContent) -> list[AxesRecord]:
        """Return the records of a bag with a topic of states an axis."""
        return [
            self._record(each)
            for track in axes_tracks(content, self.log)
            for each in sampled(track, self.log.at(content.path))
        ]

    def of_fields(self, path: Path) -> list[AxesRecord]:
        """Refuse named fields of a bag."""
        raise RecordError(
            f'{path}: of a bag, several axes are read from the topics actuator/state of their '
            'namespaces; leave the patterns out, or save a table'
        )

    def of_columns(self, path: Path) -> list[AxesRecord]:
        """Return the records of a file: of its arrays, or of its columns."""
        pairs = file_pairs(path, *self._patterns())
        if pairs:
            self._state(path)
            return [
                record
                for pair in pairs
                for record in self._of_pair(
                    pair if pair.name and path.suffix != '.npy' else replace(pair, name=path.stem)
                )
            ]
        tables = tables_of_file(path, self.log, self.options)
        return [self._record(each) for each in file_samples(path, tables, self.log, self.options)]

    def of_folder(self, path: Path) -> list[AxesRecord]:
        """Return the records of pairs of ``.npy`` files, or of all files and bags."""
        pairs = folder_pairs(path, content_of(path).files, *self._patterns())
        if not pairs:
            return super().of_folder(path)
        self._state(path)
        return [record for pair in pairs for record in self._of_pair(pair)]

    def _state(self, path: Path) -> None:
        """Note what arrays without names of columns are taken for."""
        units = {what: pattern_of(self.options.columns.get(what, ''), what)[1] for what in UNITS}
        length = units['displacement'] or self.options.unit or 'm'
        self.log.at(path).guess(
            f'its arrays are (sample, channel, ...), voltages in {units["voltage"] or "V"} and '
            f'displacements in {length}'
        )

    def _patterns(self) -> tuple[str, str]:
        chosen = self.options.columns
        voltage, displacement = (
            pattern_of(chosen.get(what, ''), what)[0] for what in ('voltage', 'displacement')
        )
        return voltage, displacement

    def _record(self, track: Track) -> AxesRecord:
        return AxesRecord(
            track.name,
            track.dt,
            np.column_stack(track.of('voltage')),
            np.column_stack(track.of('displacement')),
            periods=int(self.periodic or 0),
            level=_stated_level(track.name),
        )

    def _of_pair(self, pair: ArrayPair) -> list[AxesRecord]:
        """Return one record for each realisation, its periods one after the other."""
        name = pair.name or pair.names[0]
        step = self.options.interval or pair.interval
        if not step:
            raise RecordError(
                f'{name}: arrays have no time; give their rate with --fs HZ (in Python fs=)'
            )
        voltage, displacement = (
            self._in_si(array, what, title)
            for array, what, title in zip(
                (pair.voltage, pair.displacement), ('voltage', 'displacement'), pair.names,
                strict=True,
            )
        )  # fmt: skip
        left, right = voltage.shape, displacement.shape
        if left[:1] + left[2:] != right[:1] + right[2:]:
            raise RecordError(
                f'{name}: {pair.names[0]} has the shape {left} and {pair.names[1]} {right}; only '
                'the number of channels (second) may differ'
            )
        periods = self._periods(name, voltage.ndim, left[3] if voltage.ndim == 4 else 0)
        runs = left[2] if voltage.ndim > 2 else 1
        found = [
            AxesRecord(
                f'{name}/{k}' if runs > 1 else name,
                step,
                _in_time(voltage, k),
                _in_time(displacement, k),
                periods=periods,
                level=_stated_level(name),
            )
            for k in range(runs)
        ]
        for each in found:
            check_units(_track(each), self.log.at(f'record {each.name}'))
        return found

    def _in_si(self, array: Any, what: str, name: str) -> FloatArray:
        try:
            found = np.asarray(array, np.float64)
        except (TypeError, ValueError):
            raise RecordError(f'{name} is no array of numbers') from None
        if found.ndim == 1:
            found = found[:, None]
        if not 2 <= found.ndim <= 4 or found.size == 0:
            raise RecordError(
                f'{name} has the shape {found.shape}; arrays are (sample, channel[, realisation[, '
                'period]])'
            )
        if found.shape[0] < found.shape[1]:
            raise RecordError(
                f'{name} has the shape {found.shape}, so more channels than samples; arrays are '
                '(sample, channel[, realisation[, period]]): transpose it'
            )
        unit = pattern_of(self.options.columns.get(what, ''), what)[1]
        if what == 'displacement':
            unit = unit or self.options.unit
        return found / UNITS[what][unit] if unit else found

    def _periods(self, name: str, dimensions: int, held: int) -> int:
        """Return the number of periods of a record, from the array and from what is stated."""
        if dimensions < 4 or self.periodic is False:
            return int(self.periodic or 0)
        if self.periodic not in (None, True, held):
            raise RecordError(
                f'{name}: its arrays hold {counted(held, "period")} (fourth dimension), not '
                f'{self.periodic}'
            )
        return held


def _track(record: AxesRecord) -> Track:
    """Return the samples of a record by column."""
    columns = {f'voltage_{k}': each for k, each in enumerate(record.voltage.T, 1)}
    columns |= {f'displacement_{k}': each for k, each in enumerate(record.displacement.T, 1)}
    time = np.asarray(record.dt * np.arange(len(record)), np.float64)
    return Track(record.name, time, columns, dt=record.dt)


def _in_time(array: FloatArray, run: int) -> FloatArray:
    """Return one realisation as (samples, channels), its periods one after the other."""
    if array.ndim == 2:
        return array
    if array.ndim == 3:
        return array[:, :, run]
    return array[:, :, run].transpose(2, 0, 1).reshape(-1, array.shape[1])


def _require_alike(records: Sequence[AxesRecord], axes: int | None) -> None:
    """Refuse records of different channels or rates, or of another number of axes."""
    first = records[0]
    if axes is not None and first.axes != axes:
        raise RecordError(
            f'record {first.name}: it has {counted_axes(first.axes, first.outputs)}, not {axes} '
            'axes; give the right number, or patterns that choose the channels'
        )
    for each in records[1:]:
        one, other = ((r.axes, r.outputs) for r in (first, each))
        if one != other:
            raise RecordError(
                f'record {first.name} has {counted_axes(*one)} but record {each.name} '
                f'{counted_axes(*other)}; give records of the same channels'
            )
        if abs(each.dt / first.dt - 1) > 1e-6:
            raise RecordError(
                f'record {first.name} has {first.rate:g} Hz but record {each.name} {each.rate:g} '
                'Hz; give records of one rate'
            )


def _stated_level(name: str) -> str:
    """Return the amplitude that a name states, such as ``100mV``; empty if it states none."""
    found = re.search(r'(?<![\d.])\d+(\.\d+)? ?[mk]?V(?![A-Za-z\d])', name)
    return found[0] if found else ''
