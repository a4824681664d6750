"""The one way from tables of columns, of any file or in memory, to records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import (
    CERTAIN,
    QUANTITIES,
    UNITS,
    Meaning,
    ReadOptions,
    assigned,
    channel,
    channels_of,
    meaning,
    pattern_of,
)
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.formats.column_table import Column, ColumnTable, united
from piezo_hysteresis.records.record import Record, RecordInfo
from piezo_hysteresis.records.sampling import Track, sampled
from piezo_hysteresis.records.tabular import about

SAME_RATE = 1e-3  # steps that differ by a smaller part are of one rate
STATED = 0.01  # a time column may differ by this part from the interval that the file states
SAME_TICK = 0.01  # times closer than this part of a step are one


def file_records(
    path: Path, tables: Sequence[ColumnTable], log: DamageLog, options: ReadOptions
) -> list[Record]:
    """Return the records of a file, see `file_samples`."""
    return [each.record() for each in file_samples(path, tables, log, options)]


def file_samples(
    path: Path, tables: Sequence[ColumnTable], log: DamageLog, options: ReadOptions
) -> list[Track]:
    """Return the samples of a file: those of each table with the required columns.

    If no table has them all, the tables are read as one: some programs write one channel a group.
    """
    if sum(len(table.columns) for table in tables) < 2:
        raise RecordError(f'{path}: it holds no columns of numbers; save time, voltage and '
                          'displacement as vectors')  # fmt: skip
    info, name, rate = about(path)
    log = log.at(path)
    found: list[Track] = []
    reasons: list[RecordError] = []
    several = len(tables) > 1
    for table in tables:
        where = f'{path} ({table.name})' if several and table.name else str(path)
        part = f'{name}_{table.name}' if several and table.name else name
        try:
            track = track_of(table, part, log.at(where), options, info=info, rate=rate)
        except RecordError as error:
            reasons.append(error)
            continue
        found += _cut(track, table, log)
    if not found and not reasons:
        raise RecordError(f'{path}: nothing of it is readable as a record')
    if not found and several:
        whole = united(tables)
        try:
            track = track_of(whole, name, log, options, info=info, rate=rate)
        except RecordError:
            raise reasons[0] from None
        return sampled(track, log)
    if not found:
        raise reasons[0]
    for reason in reasons:
        log.note(f'left out: {reason}')
    return found


def _cut(track: Track, table: ColumnTable, log: DamageLog) -> list[Track]:
    """Return the samples of a table, which is cut where its names stand again without a time."""
    if table.count and track.time.size != table.count:
        what = (
            f'its header states {counted(table.count, "sample")}, the file holds {track.time.size}'
        )
        log.add(what, lost=max(table.count - track.time.size, 0), remedy='save it again')
    if not table.repeats or track.rate <= 0.0:
        return sampled(track, log)
    edges = [0, *table.repeats, track.time.size]
    log.note(f'the column names stand again: read as {len(edges) - 1} records')
    return [
        each
        for k, (a, b) in enumerate(pairwise(edges), 1)
        if b > a
        for each in sampled(replace(track.take(slice(a, b)), name=f'{track.name}.{k}'), log)
    ]


def with_voltage(table: ColumnTable) -> ColumnTable:
    """Return a table of a desired displacement as one of a record: it has no voltage yet."""
    columns = list(table.columns)
    meant = {(each.known or meaning(each.name)).what: each for each in columns}
    target = meant.get('displacement') or meant.get('reference')
    if target is None or 'voltage' in meant or 'force' in meant:
        return table
    if 'displacement' not in meant:
        unit = (target.known or meaning(target.name)).unit
        columns.append(replace(target, known=Meaning('displacement', unit, CERTAIN)))
    nothing = replace(target, values=np.zeros(target.values.size))
    columns.append(replace(nothing, known=Meaning('voltage', 'V', CERTAIN)))
    return replace(table, columns=columns)


def track_of(
    table: ColumnTable,
    name: str,
    log: DamageLog,
    options: ReadOptions,
    *,
    info: RecordInfo | None = None,
    rate: float = 0.0,
    of_file: bool = True,
) -> Track:
    """Return the samples of one table in SI units, with their times; of several axes if asked."""
    if options.axes:
        return _track_of_axes(table, name, log, options, rate)
    columns = table.columns
    hints = _known(columns)
    has_clock = any(each.time is not None for each in columns)
    stated = options.interval or table.interval
    needed = ('voltage', 'displacement') if stated or has_clock else _ALL
    meanings, guessed = assigned(
        [each.name for each in columns], log.where, chosen=options.columns, hints=hints,
        length=options.unit, needed=needed, of_file=of_file,
    )  # fmt: skip
    for sentence in table.assumed:
        log.guess(sentence)
    if guessed:
        log.guess(f'reading {guessed}')
    found = {
        what: replace(
            columns[k],
            values=columns[k].values
            if UNITS[what][unit] == 1.0
            else columns[k].values / UNITS[what][unit],
            known=Meaning(what),
        )
        for k, (what, unit) in meanings.items()
    }
    info = info or RecordInfo()
    if 'force' in found:
        found['voltage'] = found.pop('force')
        info = replace(info, input_unit='N')
    if table.sparse:
        found = _held(found, log)
    time, values, step = _timed(found, table, log, options)
    return Track(name, time, values, info=info, rate=1.0 / step if step else rate)


def _known(columns: Sequence[Column]) -> dict[int, Meaning]:
    return {k: each.known for k, each in enumerate(columns) if each.known is not None}


def _track_of_axes(
    table: ColumnTable, name: str, log: DamageLog, options: ReadOptions, rate: float
) -> Track:
    """Return the samples of all axes on their one clock: the tracks of pairs of channels."""
    names = [each.name for each in table.columns]
    places = channels_of(names, log.where, options, _known(table.columns))
    units = {what: pattern_of(options.columns.get(what, ''), what)[1] for what in QUANTITIES}
    pairs: list[Track] = []
    columns: dict[str, FloatArray] = {}
    for k in range(max(map(len, places.values()))):
        chosen = {
            what: channel(names, each[min(k, len(each) - 1)], units[what])
            for what, each in places.items()
        }
        one = replace(options, axes=False, columns={**options.columns, **chosen})
        pairs.append(track_of(table, name, log, one, rate=rate))
        if not np.array_equal(pairs[k].time, pairs[0].time):
            raise RecordError(
                f'{log.where}: the displacements {names[places["displacement"][0]]!r} and '
                f'{chosen["displacement"]!r} have different times; save all axes from one clock'
            )
        columns |= {f'{w}_{k + 1}': pairs[k].columns[w] for w in QUANTITIES if k < len(places[w])}
    return Track(name, pairs[0].time, columns, rate=pairs[0].rate)


_ALL = ('time', 'voltage', 'displacement')


def _timed(
    found: dict[str, Column], table: ColumnTable, log: DamageLog, options: ReadOptions
) -> tuple[FloatArray, dict[str, FloatArray], float]:
    """Return times, values by quantity and the stated interval [s]; 0 if the times count."""
    found = dict(found)
    own = found.pop('time', None)
    if options.interval is not None:
        if own is not None:
            log.guess(f'its column {own.name!r} is not used: the interval is given')
        values = _of_one_length(found, log.where)
        return _even(options.interval, values), values, options.interval
    if own is not None:
        values = _of_one_length({'time': own, **found}, log.where)
        time = _checked(values.pop('time'), table.interval, log)
        return time, values, 0.0
    if any(each.time is not None for each in found.values()):
        return *_on_one_clock(found, log), 0.0
    if table.interval <= 0.0:
        raise RecordError(
            f'{log.where}: it has no time; give its sampling interval with --interval SECONDS (in '
            'Python dt=)'
        )
    values = _of_one_length(found, log.where)
    return _even(table.interval, values), values, table.interval


def _even(step: float, values: Mapping[str, FloatArray]) -> FloatArray:
    return np.asarray(step * np.arange(values['displacement'].size), np.float64)


def _of_one_length(found: Mapping[str, Column], where: str) -> dict[str, FloatArray]:
    if len({each.values.size for each in found.values()}) > 1:
        listed = ', '.join(f'{each.name} {each.values.size}' for each in found.values())
        raise RecordError(
            f'{where}: its columns differ in length ({listed}): two rates are no record; save '
            'those of one rate together'
        )
    return {what: each.values for what, each in found.items()}


def _checked(time: FloatArray, interval: float, log: DamageLog) -> FloatArray:
    """Return the times, made exact if they are rounded and the file states the interval."""
    if interval <= 0.0 or time.size < 3 or not np.all(np.isfinite(time)):
        return time
    steps = np.diff(time)
    mean = float(np.median(steps)) if np.median(steps) > 0 else float(np.mean(steps))
    even = time[0] + interval * np.arange(time.size)
    if np.abs(time - even).max() < interval:
        if np.any(steps <= 0):
            log.guess(f'its times are rounded: every {interval:.6g} s, as it states')
            return np.asarray(even, np.float64)
        return time
    if abs(mean / interval - 1) > STATED:
        raise RecordError(
            f'{log.where}: its header states an interval of {interval:.6g} s but its times one of '
            f'{mean:.6g} s; give the true one with --interval SECONDS (in Python dt=)'
        )
    return time


def _on_one_clock(
    found: dict[str, Column], log: DamageLog
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the times of the displacement, and what every other column is at them.

    Columns of one rate may start apart: each is then held until its next sample.
    """
    clock = found['displacement'].time
    if clock is None:
        clock = next(each.time for each in found.values() if each.time is not None)
    silent = [each.name for each in found.values() if each.time is None]
    if silent:
        sizes = {what: each for what, each in found.items() if each.time is None}
        first = Column('its clock', clock)
        _of_one_length({**sizes, 'time': first}, log.where)
        log.guess(f'{", ".join(silent)} states no time: taken as that of the others')
    values = {'displacement': found['displacement'].values}
    ticks, step = clock, _step(clock)
    keep = np.ones(ticks.size, np.bool_)
    for what, each in found.items():
        times = clock if each.time is None else each.time
        if times is clock or (
            times.size == ticks.size and np.abs(times - ticks).max() < SAME_TICK * step
        ):
            values[what] = each.values
            continue
        if abs(_step(times) / step - 1) > SAME_RATE:
            raise RecordError(
                f'{log.where}: {what} and displacement have different increments: two rates are '
                f'no record ({1 / _step(times):.6g} and {1 / step:.6g} Hz); save them at one rate'
            )
        place = np.searchsorted(times, ticks + SAME_TICK * step, side='right') - 1
        keep &= (place >= 0) & (ticks < times[-1] + step * (1 - SAME_TICK))
        values[what] = each.values[np.maximum(place, 0)]
        log.guess(
            f'{what} starts {1e3 * (times[0] - ticks[0]):.6g} ms after displacement: joined by '
            'time, held until its next sample'
        )
    if not keep.any():
        raise RecordError(f'{log.where}: its columns share no time; save them from one clock')
    if not keep.all():
        lost = counted(int((~keep).sum()), 'sample')
        log.note(f'{lost} at the ends left out, where a column is missing')
    return ticks[keep], {what: column[keep] for what, column in values.items()}


def _step(times: FloatArray) -> float:
    if times.size < 2:
        raise RecordError('a column has one sample; record at least a few periods')
    step = float(np.median(np.diff(times)))
    if not step > 0.0:
        raise RecordError('most times of a column do not advance; save it again')
    return step


def _in_order(found: dict[str, Column], log: DamageLog) -> dict[str, Column]:
    """Return rows by time, where each signal is in its order but a row of another is not."""
    times = found['time'].values if 'time' in found else np.empty(0)
    signals = [each.values for what, each in found.items() if what != 'time']
    if np.all(np.diff(times) >= 0.0) or any(
        not np.all(np.diff(times[~np.isnan(each)]) >= 0.0) for each in signals
    ):
        return found
    order = np.argsort(times, kind='stable')
    log.guess('rows of one signal stand behind later ones of another: sorted by time')
    return {what: replace(each, values=each.values[order]) for what, each in found.items()}


def _held(found: dict[str, Column], log: DamageLog) -> dict[str, Column]:
    """Return rows with a displacement; the other columns hold their last value."""
    found = _in_order(found, log)
    rows = np.flatnonzero(~np.isnan(found['displacement'].values))
    held: dict[str, FloatArray] = {}
    first, apart = 0, False
    for what, each in found.items():
        filled = np.flatnonzero(~np.isnan(each.values))
        if not filled.size or not rows.size:
            raise RecordError(f'{log.where}: its column {each.name!r} is empty')
        place = np.searchsorted(filled, rows, side='right') - 1
        first = max(first, int(np.sum(place < 0)))
        apart |= not np.array_equal(filled[np.maximum(place, 0)], rows)
        held[what] = each.values[filled[np.maximum(place, 0)]]
        if 'time' in found and what not in ('time', 'displacement'):
            times = found['time'].values
            steps = np.diff(times[filled])
            usual = float(np.median(steps)) if steps.size else np.inf
            pauses = int(np.sum(steps > 1.5 * usual))
            pauses += bool(times[rows[-1]] - times[filled[-1]] > (1.0 + SAME_TICK) * usual)
            if pauses:
                log.note(f'{what} pauses {counted(pauses, "time")} and is held', count=pauses)
    if apart:
        log.guess('its signals stand in rows of their own: a voltage is held until the next')
    return {what: replace(each, values=held[what][first:]) for what, each in found.items()}
