"""From time stamps to records at a constant rate: order, doubles, gaps, rates and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray, IntArray
from piezo_hysteresis.common.stamps import REORDERED
from piezo_hysteresis.common.wording import counted, not_numbers
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import SECOND
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.plausible import unit_findings
from piezo_hysteresis.records.record import Record, RecordInfo

SHORTEST = 16  # a shorter piece is of no use to anyone [samples]
SAME_TIME = 1e-12  # stamps closer than this are one [s]
GAP = 1.5  # a longer step, in median steps, is a gap
UNEVEN = 0.2  # steps may differ from their median by this part
WANDER = 0.05  # numbered samples: stamps may leave an even rate by this part of the record
LARGEST_WANDER = 0.25  # and by this one if the rate is the same nearly everywhere
RARE = 0.05  # part of the stamps that may stand twice
LOCAL = 32  # window in which the rate is estimated [steps]
JITTER = 0.05  # jitter below this part of a step is not worth a note
LARGEST_NUMBER = 1e15  # upper bound of plausible values in any unit; exact in float64


@dataclass(frozen=True)
class Track:
    """Samples as read, before their order is checked."""

    name: str  # name of the resulting record
    time: FloatArray  # time of each sample [s], shape (n,)
    columns: dict[str, FloatArray]  # [V] [m], shape (n,)
    sample: IntArray | None = None  # number of each sample, if the source counts them, shape (n,)
    info: RecordInfo = field(default_factory=RecordInfo)  # metadata
    rate: float = 0.0  # sampling rate stated by the source, 0 if unknown [Hz]
    dt: float = 0.0  # sampling interval, 0 until it is known to be constant [s]

    def take(self, index: IntArray | BoolArray | slice) -> Track:
        """Return some of the samples."""
        return replace(
            self,
            time=self.time[index],
            columns={key: column[index] for key, column in self.columns.items()},
            sample=None if self.sample is None else self.sample[index],
        )

    def of(self, quantity: str) -> list[FloatArray]:
        """Return the columns of one quantity: one, or one for each axis."""
        return [each for key, each in self.columns.items() if key.startswith(quantity)]

    def record(self) -> Record:
        """Return samples at a constant rate as a record of one axis."""
        return Record(
            self.name,
            self.dt,
            self.columns['voltage'],
            self.columns['displacement'],
            start=float(self.time[0]),
            reference=self.columns.get('reference'),
            second=second_of(self.columns),
            info=self.info,
        )


def second_of(columns: Mapping[str, FloatArray]) -> FloatArray | None:  # shape (n,)
    """Return a second channel: another sensor, a charge, or a current summed to one."""
    for what in SECOND:
        if what in columns:
            return np.cumsum(columns[what]) if what == 'current' else columns[what]
    return None


def records_of(track: Track, log: DamageLog) -> list[Record]:
    """Return the samples of a track as one record, or as its intact pieces when salvaging.

    Parameters and errors are those of `sampled`.
    """
    return [each.record() for each in sampled(track, log)]


def sampled(track: Track, log: DamageLog) -> list[Track]:
    """Return the samples of a track at a constant rate, or its intact pieces when salvaging."""
    named = log.at(f'{log.where}: record {track.name}')
    if track.sample is not None and track.sample.size and np.all(track.sample == track.sample[0]):
        track = replace(track, sample=None)
    track = _finite(track, named)
    return [piece for run in _runs(track, named) for piece in _pieces_of(run, log)]


def _pieces_of(track: Track, log: DamageLog) -> list[Track]:
    """Return one run at a constant rate, or its intact pieces when salvaging."""
    log = log.at(f'{log.where}: record {track.name}')
    track = _ordered(track, log)
    if track.time.size < 2:
        log.add(f'it has {counted(track.time.size, "sample")}, too few to know its rate')
        return []
    pieces = [piece for part in _split_at_gaps(track, log) for piece in _split_by_rate(part, log)]
    whole = [piece for piece in pieces if piece.time.size >= min(SHORTEST, track.time.size)]
    lost = track.time.size - sum(piece.time.size for piece in whole)
    if lost:
        log.add(f'{counted(lost, "sample", "lies")} in pieces too short to be of use', lost=lost)
    names = [track.name]
    if len(whole) > 1:
        names = [f'{track.name}.{number}' for number in range(1, len(whole) + 1)]
    found = [
        replace(piece, name=name, dt=_interval(piece, log))
        for piece, name in zip(whole, names, strict=False)
    ]
    for each in found:
        check_units(each, log)
    return found


def _finite(track: Track, log: DamageLog) -> Track:
    every = [track.time, *track.columns.values()]
    # a comparison with NaN is false
    if all(x.size and x.min() > -LARGEST_NUMBER and x.max() < LARGEST_NUMBER for x in every):
        return track
    good = np.abs(track.time) < LARGEST_NUMBER
    for column in track.columns.values():
        good &= np.abs(column) < LARGEST_NUMBER
    bad = int(good.size - good.sum())
    if bad:
        first = int(np.argmin(good))
        log.add(
            f'{bad} of {good.size} samples {not_numbers(bad)}, the first is number {first}',
            count=bad,
            lost=bad,
            remedy='mend them',
            done='left out',
        )
        track = track.take(good)
    return track


def restarts(sample: IntArray, log_time: IntArray) -> IntArray:  # sample (n,); log_time [ns] (n,)
    """Return the places at which the numbers of samples start again, shape (r,).

    Empty where that is ambiguous: numbers that are out of order, or pieces too short for a run.
    """
    falls = np.flatnonzero(np.diff(sample) < 0) + 1
    if not falls.size or np.any(np.diff(log_time)[falls - 1] < 0):
        return np.zeros(0, np.int64)
    edges = [0, *falls.tolist(), sample.size]
    first = sample[edges[:-1]]
    far = (sample[falls - 1] - sample[falls] > REORDERED) | (sample[falls] <= first[:-1])
    return falls if far.all() and min(np.diff(edges)) >= SHORTEST else np.zeros(0, np.int64)


def _runs(track: Track, log: DamageLog) -> list[Track]:
    """Return the runs of a track whose time starts again, each as a record of its own.

    Runs are never sorted into each other: where that gives an even rate, samples are only out of
    order, which is damage.
    """
    if track.sample is not None or track.time.size < 2 * SHORTEST:
        return [track]
    steps = np.diff(track.time)
    falls = np.flatnonzero(steps < 0) + 1
    if not falls.size:
        return [track]
    runs = [track.take(slice(a, b)) for a, b in pairwise([0, *falls.tolist(), track.time.size])]
    together = np.diff(np.sort(track.time))
    median = float(np.median(np.abs(steps)))
    even = np.all(np.abs(together - median) <= UNEVEN * median)
    if even or any(run.time.size < SHORTEST or _has_gap(run.time) for run in runs):
        return [track]
    first, often = int(falls[0]), counted(falls.size, 'time')
    log.guess(
        f'its time starts again {often}, first at sample {first + 1} '
        f'({track.time[first]:.6g} s after {track.time[first - 1]:.6g} s): read as {len(runs)} '
        'records',
    )  # fmt: skip
    return [replace(run, name=f'{track.name}.{k}') for k, run in enumerate(runs, 1)]


def _has_gap(time: FloatArray) -> bool:
    steps = np.diff(time)
    return bool(np.any(steps > GAP * np.median(steps)))


def _refuse_two_senders(track: Track, place: str) -> None:
    """Refuse samples of two senders between each other, which no order makes one record.

    Every second sample is even by itself, and the displacement is far rougher together than apart.
    """
    time, moved = track.time, track.of('displacement')[0]
    if time.size < 2 * SHORTEST:
        return
    steps = np.diff(time)
    if _even(steps):
        return
    every = time[2:] - time[:-2]
    uneven = np.mean(np.abs(steps - np.median(steps)) > UNEVEN * np.median(steps)) > 0.1
    if not uneven or np.mean(np.abs(every - np.median(every)) > UNEVEN * np.median(every)) > 0.1:
        return
    apart = np.abs(moved[4:] - 2 * moved[2:-2] + moved[:-4])
    together = np.abs(moved[2:] - 2 * moved[1:-1] + moved[:-2])
    if np.median(together) > 3 * np.median(apart):
        raise RecordError(
            f'{place}: two sequences of samples lie between each other (two senders, or two runs '
            'sorted by time); record or save each by itself'
        )


def _ordered(track: Track, log: DamageLog) -> Track:
    """Sort by number, or by time without numbers, and drop duplicate samples."""
    key: FloatArray | IntArray = track.time
    if track.sample is not None and np.unique(track.sample).size == track.sample.size:
        key = track.sample  # regardless of the stamps
    back = int(np.sum(np.diff(key) < 0))
    if back:
        what = f'{counted(back, "sample", "is")} out of order'
        log.add(what, count=back, remedy='sort them by time', done='sorted')
        track = track.take(np.argsort(key, kind='stable'))
    _refuse_two_senders(track, log.where)
    track = _spread(track, log)
    again = np.zeros(track.time.size, np.bool_)
    if track.sample is None:
        again[1:] = np.diff(track.time) < SAME_TIME
    else:
        again[1:] = np.diff(track.sample) == 0
        track, again = _without_repeats(track, again, log)
    doubled = int(again.sum())
    if doubled:
        what = f'{counted(doubled, "sample", "comes")} twice'
        if track.sample is None:
            what = f'{counted(doubled, "time", "stands")} twice'
        remedy = 'write each sample once, with enough digits of its time'
        log.add(what, count=doubled, lost=doubled, remedy=remedy, done='kept once')
        track = track.take(~again)
    return track


def _spread(track: Track, log: DamageLog) -> Track:
    """Return the samples at an even rate if a few stamps stand twice and the numbers agree."""
    time, size = track.time, track.time.size
    if track.sample is not None or size < SHORTEST:
        return track
    again = np.flatnonzero(np.diff(time) < SAME_TIME)
    if not 0 < again.size <= RARE * size:
        return track
    rows = np.array(list(track.columns.values()))
    if np.any(np.all(rows[:, again] == rows[:, again + 1], axis=0)):
        return track  # a sample that was written twice
    even = time[0] + (time[-1] - time[0]) / (size - 1) * np.arange(size)
    if np.abs(time - even).max() >= 1.5 * (even[1] - even[0]):
        return track
    log.guess(
        f'{counted(again.size, "time", "stands")} twice with other values: taken at an even rate'
    )
    return replace(track, time=even)


def _without_repeats(track: Track, again: BoolArray, log: DamageLog) -> tuple[Track, BoolArray]:
    """Drop repeated messages: nodes repeat their last message when a loop stalls."""
    same = again.copy()
    for column in (track.time, *track.columns.values()):
        same[1:] &= column[1:] == column[:-1]
    repeats = int(same.sum())
    if repeats:
        log.note(f'{counted(repeats, "message", "was")} repeated by the sender', count=repeats)
    return track.take(~same), again[~same]


def _steps(track: Track) -> FloatArray:
    """Return the time per sample number between neighbours [s], shape (n - 1,)."""
    steps = np.diff(track.time)
    if track.sample is not None:
        steps = steps / np.maximum(np.diff(track.sample), 1)
    return steps


def _even(steps: FloatArray) -> bool:
    """Return whether no step can differ from the median by more than is allowed."""
    least = float(steps.min())
    return float(steps.max()) - least <= UNEVEN * least


def _split_at_gaps(track: Track, log: DamageLog) -> list[Track]:
    if track.sample is not None:
        counts = np.diff(track.sample)
        restarts = int(np.sum(counts < 0))
        if restarts:
            log.add(f'the numbers of the samples start again {counted(restarts, "time")}',
                    count=restarts, remedy='record a marker in front of each run')  # fmt: skip
        missing = np.where(counts > 1, counts - 1, 0)
        cuts = np.flatnonzero(counts != 1) + 1
    else:
        steps = np.diff(track.time)
        if _even(steps):
            return [track]
        median = float(np.median(steps))
        long = steps > GAP * median
        if long.sum() > 0.1 * long.size:
            return [track]  # not gaps: the rate changes
        missing = np.where(long, np.round(steps / median) - 1, 0)
        cuts = np.flatnonzero(long) + 1
    if missing.any():
        number, total = int((missing > 0).sum()), int(missing.sum())
        first = float(track.time[np.argmax(missing > 0)])
        log.add(
            f'{counted(total, "sample", "is")} missing in {counted(number, "gap")}, the first '
            f'after {first:.6g} s',
            count=number,
            lost=0,
            remedy='record again without loss',
            done='cut into records there',
        )
    edges = [0, *cuts.tolist(), track.time.size]
    return [track.take(slice(a, b)) for a, b in pairwise(edges)]


def _split_by_rate(track: Track, log: DamageLog) -> list[Track]:
    """Return the track if its rate is constant, else its stretches of constant rate."""
    if track.time.size < 3:
        return [track]
    steps = _steps(track)
    mean = (track.time[-1] - track.time[0]) / (track.time.size - 1)
    wander = np.abs(track.time - track.time[0] - mean * np.arange(track.time.size)).max()
    steady = 0.5 if track.sample is None else JITTER
    if _even(steps) and mean > 0.0 and wander < steady * mean:
        return [track]
    median = np.median(steps)
    odd = np.abs(steps - median) > UNEVEN * median
    if not median > 0:
        log.add('most of its stamps do not advance', count=int(np.sum(steps <= 0)),
                remedy='let the driver stamp each state with its time')  # fmt: skip
        return []
    if not odd.any() and wander < steady * mean:
        return [track]
    runs = _even_runs(steps)
    off = sum(b - a for a, b in runs if odd[a:b].all())
    if (
        track.sample is not None
        and mean > 0
        and off <= 0.1 * steps.size
        and _returns(track, wander / mean)
    ):
        what = f'its stamps jitter by up to {1e3 * wander:.3g} ms'
        if abs(mean / median - 1) > 0.01:
            what += f' (its driver was held up: {1 / mean:.4g} Hz on average)'
        log.note(f'{what}; its samples are taken at an even rate, by their numbers',
                 count=int(odd.sum()))  # fmt: skip
        return [track]
    if len(runs) < 2:
        return [_resampled(track, log)]
    periods = [float(np.median(steps[a:b])) for a, b in runs]
    listed = ', '.join(dict.fromkeys(f'{1 / period:.6g}' for period in periods if period > 0))
    what = f'the rate changes within the record ({listed} Hz)'
    remedy = 'make a record of each rate'
    if max(periods) <= (1 + UNEVEN) * min(periods):
        what = f'its stamps jump by up to {float(np.abs(steps - median).max()):.3g} s'
        remedy = 'record again with a steady clock'
    log.add(what, count=len(runs) - 1, remedy=remedy)
    ends = {b for _, b in runs}  # a sample between two rates belongs to the first
    return [track.take(slice(a + (a in ends), b + 1)) for a, b in runs]


def _returns(track: Track, wander: float) -> bool:
    """Return whether stamps that leave an even rate by `wander` steps are only late now and then.

    They come back, or a driver was held up: then most steps are those of the stated rate, or the
    rate is the same nearly everywhere.
    """
    number = track.time.size
    if wander < max(WANDER * number, SHORTEST) or _usually(track):
        return True
    local = _local_steps(track)
    median = np.median(local)
    odd = np.abs(local - median) > UNEVEN * median
    return bool(wander < LARGEST_WANDER * number and odd.mean() < 0.25)


def _usually(track: Track) -> bool:
    """Return whether the middle one of all steps is that of the stated rate."""
    return bool(abs(track.rate * np.median(np.diff(track.time)) - 1) < 0.02)


def _local_steps(track: Track) -> FloatArray:
    """Return the mean step around each sample of an even numbering [s]."""
    span = min(LOCAL, track.time.size - 1)
    return np.asarray((track.time[span:] - track.time[:-span]) / span, np.float64)


def _even_runs(steps: FloatArray) -> list[tuple[int, int]]:
    """Return the evenly sampled intervals if they cover nearly all samples; else none."""
    changes = np.flatnonzero(np.abs(np.diff(steps)) > UNEVEN * steps[:-1]) + 1
    edges = [0, *changes.tolist(), steps.size]
    runs = [(a, b) for a, b in pairwise(edges) if b - a >= SHORTEST]
    return runs if sum(b - a for a, b in runs) >= 0.9 * steps.size else []


def _resampled(track: Track, log: DamageLog) -> Track:
    """Return the samples interpolated at a constant rate: only on request."""
    steps = np.diff(track.time)
    low, high = 1e3 * np.quantile(steps, [0.05, 0.95])
    message = f'the rate is uneven, steps are {low:.4g} to {high:.4g} ms'
    if log.interpolate:
        log.note(f'{message}: interpolated', count=track.time.size)
    else:
        log.add(
            message,
            count=track.time.size,
            remedy='sample at a constant rate, `import` it with --resample RATE',
            done='interpolated at its mean rate',
        )
    track = track.take(np.argsort(track.time, kind='stable'))
    number = track.time.size
    time = np.linspace(track.time[0], track.time[-1], number)
    columns = {key: np.interp(time, track.time, column) for key, column in track.columns.items()}
    return replace(track, time=time, columns=columns, sample=None, rate=0.0)


def _interval(track: Track, log: DamageLog) -> float:
    """Return the sampling interval [s]: as stated, or the roundest that the stamps allow."""
    number = track.time.size
    dt = float(track.time[-1] - track.time[0]) / (number - 1)
    if not dt > 0:
        return dt  # which no record can have
    digits, slack = [6], 0.02  # in steps over the whole record
    if track.sample is not None:
        ticks = np.arange(number)
        off = float(np.abs(track.time - track.time[0] - dt * ticks).max() / dt)
        if off > JITTER:
            digits, slack = [1, 2, 3, 4, 5, 6], off
            # Where a driver was held up for a while, the rate before and behind is the true one.
            usual = float(np.median(_local_steps(track)))
            dt = dt if abs(usual / dt - 1) < 0.01 else usual
    stated = track.rate if np.isfinite(track.rate) else 0.0
    if stated > 0:
        near = max(0.01, 2 * min(slack, SHORTEST) / number)
        if abs(stated * dt - 1) <= near or (track.sample is not None and _usually(track)):
            return 1 / stated
        log.add(f'its marker says {stated:.6g} Hz but its samples come at {1 / dt:.6g} Hz')
    for count in digits:
        exact = 1 / float(f'{1 / dt:.{count}g}')
        if abs(exact - dt) * number < slack * dt:
            return exact
    return dt


def check_units(track: Track, log: DamageLog) -> None:
    """Refuse values that can only be a mistaken unit; list those that may be one."""
    inputs, outputs = track.of('voltage'), track.of('displacement')
    for certain, sentence in unit_findings(track.dt, inputs, outputs, track.info.input_unit):
        if certain:
            log.refuse(sentence)
        else:
            log.unlikely(sentence)


# Numerator and denominator of the ratio of two rates are no larger.
FINEST = 200
# Ticks by which two grids may differ over a record and still be one.
SAME = 1e-9


def resampled(record: Record, rate: float) -> Record:  # rate [Hz]
    """Return a record at another rate, after an anti-aliasing filter.

    Input, displacement and reference pass the same zero-phase filter, so that none is shifted
    relative to another.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordError(f'--resample {rate:g}: a rate in Hz is above 0')
    if not 1e-3 <= rate * record.dt <= 1e3:
        raise RecordError(
            f'{record.name}: {record.rate:g} Hz cannot be made {rate:g} Hz: more than a thousand '
            'times fewer or more samples'
        )
    if abs(rate * record.dt - 1.0) < SAME:
        return replace(record, dt=1.0 / rate)
    reference = record.reference
    return replace(
        record,
        dt=1.0 / rate,
        voltage=_at(record.voltage, record.dt, rate),
        displacement=_at(record.displacement, record.dt, rate),
        reference=None if reference is None else _at(reference, record.dt, rate),
        second=None if record.second is None else _at(record.second, record.dt, rate),
    )


def _at(signal: FloatArray, dt: float, rate: float) -> FloatArray:
    """Return a signal at another rate: filtered at a near ratio, interpolated for the rest."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import resample_poly

    ratio = Fraction(rate * dt).limit_denominator(FINEST)
    found = resample_poly(signal, ratio.numerator, ratio.denominator, padtype='line')
    step = dt * ratio.denominator / ratio.numerator
    if abs(step * rate - 1.0) * found.size > SAME:
        time = np.arange(found.size) * step
        instants = np.arange(int(time[-1] * rate) + 1) / rate
        found = CubicSpline(time, found)(instants)
    return np.asarray(found, np.float64)
