"""Data of a fit: whole records, or the mean of their periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, hypot, nan, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.initial_conditions.record_start import (
    NEAR_ZERO,
    SETTLED,
    SETTLING,
    STEP,
    RecordStart,
    first_guess,
    lead_in,
)
from piezo_hysteresis.identification.noise import (
    SURE,
    Noise,
    bad_samples,
    independent,
    noise_of,
    noises_of,
)
from piezo_hysteresis.identification.outliers import interpolated
from piezo_hysteresis.identification.periods import period_of, periodic_from
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.records import Record

#: Ticks for which the last voltage is held: a recording may read the displacement that much later.
LEAD_OUT = 2
#: Behind the name of a record: its way into the steady state.
WAY_IN = ' (start)'


@dataclass(frozen=True)
class Target:
    """Data of one record for a fit.

    Attributes
    ----------
    name : str
        Name of the record.
    voltage : ndarray, shape (n,)
        What the model is driven with from the virgin state at 0 V, up to the last compared sample
        [V].
    measured : ndarray, shape (m,)
        Displacement that samples ``first, first + stride, ...`` are compared with [m].
    first, stride : int
        Where the comparison starts, and its step.
    dt : float
        Sampling interval [s].
    frequency : float
        Fundamental frequency of the drive [Hz], 0 where there is none.
    repeats : int
        Periods that `measured` is the mean of; 1 where nothing was folded.
    noise : float
        Rms noise of one sample [m], see `noise.noises_of`; NaN where it is not known.
    noise_colour : float
        Correlation of its noise from one compared sample to the next; 0 for white noise.
    rounding : float
        Share of the mean square of its noise that may not be seen, see `noise.Noise`.
    period : int
        Samples per folded period; 0 where nothing was folded.
    start : float
        Time of the first driven sample [s], for blocks that depend on it.
    origin : int
        Driven sample at which the record begins; what is before leads in.
    begins : RecordStart
        How it is taken to begin.
    own_zero : bool
        Whether its displacement is counted from a zero of its own.
    precision : float
        Factor of its residual besides that of its repeats: how well a sample of it is known
        against those of the other targets.
    valid : ndarray, shape (m,), or None
        1 where a compared sample counts, 0 where it is a spike or lost; None where all count.
    influence : ndarray, shape (m,), or None
        Factor of each residual in a fit, 1 or less where it is far out; None where all are 1.
    """

    name: str
    voltage: FloatArray
    measured: FloatArray
    first: int
    stride: int
    dt: float
    frequency: float
    repeats: int
    noise: float
    period: int
    start: float = 0.0
    origin: int = 0
    begins: RecordStart = STEP
    own_zero: bool = False
    precision: float = 1.0
    noise_colour: float = 0.0
    rounding: float = 0.0
    valid: FloatArray | None = None
    influence: FloatArray | None = None

    @property
    def weight(self) -> float:
        """Factor by which a residual counts: it stands for `repeats` periods, and by its noise."""
        return sqrt(self.repeats) * self.precision

    @property
    def excess_deviation(self) -> float:
        """Standard deviation of the mean square that noise leaves, as a share of it."""
        numbers = independent(self.measured.size, self.noise_colour)
        return hypot(sqrt(2.0 / numbers), self.rounding / SURE)

    @property
    def lost(self) -> int:
        """Number of samples that do not count."""
        return 0 if self.valid is None else int(self.valid.size - self.valid.sum())

    @property
    def factors(self) -> FloatArray | None:
        """Factor of each residual in a fit: its influence, 0 where it is lost; None for 1."""
        if self.valid is None or self.influence is None:
            return self.influence if self.valid is None else self.valid
        return self.valid * self.influence

    def begins_like(self, other: Target) -> bool:
        """Return whether two targets have the same initial condition and kind of zero."""
        return self.begins == other.begins and self.own_zero == other.own_zero

    def kept(self, samples: FloatArray) -> FloatArray:
        """Return the valid ones of the compared samples, shape (m,)."""
        return samples if self.valid is None else samples[self.valid > 0.0]

    @cached_property
    def drive(self) -> FloatArray:
        """Voltage with its last value held for two ticks, shape (n + 2,) [V]."""
        return np.concatenate([self.voltage, np.repeat(self.voltage[-1:], LEAD_OUT)])

    @property
    def compared(self) -> slice:
        """The driven samples that are compared."""
        return slice(self.first, self.voltage.size, self.stride)

    def pick(self, simulated: FloatArray) -> FloatArray:
        """Return the compared samples of a response, shape (n,) or (n + 2,); shape (m,)."""
        return simulated[self.compared]


def fold(record: Record, settling: float = SETTLING) -> list[Target]:
    """Average the steady periods of a record; return nothing where it has no two of them.

    The transient before the steady state is a second target, ``NAME (start)``, where the record
    begins near 0 V, so that folding loses no information. The transient of a record that begins
    in motion depends on an unknown history and is left out.

    A record is steady where the periods, seen from its end, differ by their scatter only. One that
    drifts or creeps through all its periods is not folded: no model has its mean period.
    """
    period = period_of(record)
    if period == 0:
        return []
    same = periodic_from(record.voltage, period)
    first = max(same, record.warm_up_samples)
    count = (len(record) - first) // period
    if count < 2:
        return []
    first = len(record) - count * period
    measured = interpolated(record.displacement, bad_samples(record), period)
    periods = measured[first:].reshape(count, period)
    steady = _steady(periods)
    if steady is None:
        return []
    start, noise = steady
    kept = periods[start:]
    begin = first + start * period
    voltage, offset = _drive(record, period, begin, settling)
    mean = Target(
        name=record.name,
        voltage=voltage,
        measured=kept.mean(axis=0),
        first=offset,
        stride=1,
        dt=record.dt,
        frequency=record.info.frequency,
        repeats=len(kept),
        noise=noise,
        period=period,
        start=record.start,
        begins=SETTLED,
    )
    from_rest = abs(record.voltage[0]) <= NEAR_ZERO * float(np.max(np.abs(record.voltage)))
    if not from_rest or begin - record.warm_up_samples < 2:
        return [mean]
    way_in = _of_all_samples(record.section(0, begin), 1, STEP)
    return [mean, replace(way_in, name=record.name + WAY_IN, noise=noise)]


def _steady(periods: FloatArray) -> tuple[int, float] | None:
    """First steady period and the noise of one sample, or None where there are no two."""
    count, samples = periods.shape
    tail = periods[count // 2 :] if count >= 4 else periods[-2:]
    mean = tail.mean(axis=0)
    scatter = sqrt(float(np.sum((tail - mean) ** 2)) / ((len(tail) - 1) * samples))
    # short periods scatter more about their rms
    chance = 5 / sqrt(2 * samples)
    limit = max((1 + max(0.3, chance)) * scatter, 1e-6 * float(np.std(periods[-1])))
    away = np.sqrt(np.mean((periods - mean) ** 2, axis=1))
    start = int(np.flatnonzero(away > limit)[-1]) + 1 if np.any(away > limit) else 0
    kept = periods[start:]
    if len(kept) < 2:
        return None
    noise = sqrt(float(np.sum((kept - kept.mean(axis=0)) ** 2)) / ((len(kept) - 1) * samples))
    if len(kept) >= 3:
        levels = kept.mean(axis=1)
        drift = abs(float(np.polyfit(np.arange(len(kept)), levels, 1)[0])) * len(kept)
        if drift > max(max(0.5, 2 * chance) * noise, 1e-6 * float(np.std(periods[-1]))):
            return None
    return start, noise


def _drive(record: Record, period: int, first: int, settling: float) -> tuple[FloatArray, int]:
    """Voltage from the start of the record through enough periods, and the last one's start."""
    needed = ceil(settling / (period * record.dt)) * period
    begin = periodic_from(record.voltage, period)
    # phase of the folded period, moved as early as the settling time allows
    start = first + period * ceil(max(begin + needed - first, 0) / period)
    start -= period * ((start - begin - needed) // period)
    end = start + period
    voltage = record.voltage[:end]
    if voltage.size < end:
        cycle = record.voltage[first : first + period]
        more = np.resize(cycle, end - first)
        voltage = np.concatenate([record.voltage[:first], more])
    return np.ascontiguousarray(voltage), start


def with_noise(target: Target, noise: Noise) -> Target:
    """Return a target whose noise is estimated from more than its own record."""
    colour = noise.memory**target.stride
    return replace(target, noise=noise.rms, noise_colour=colour, rounding=noise.rounding)


def whole(record: Record, stride: int = 1, begins: RecordStart = STEP) -> Target:
    """Return the record as it is, compared from its warm-up on, at every `stride`-th sample.

    Parameters
    ----------
    record : Record
        What was measured.
    stride : int
        Every so many samples are compared.
    begins : RecordStart
        How the model is led in.
    """
    return with_noise(_of_all_samples(record, stride, begins), noise_of(record))


def _of_all_samples(record: Record, stride: int, begins: RecordStart) -> Target:
    """Return the target of a whole record whose noise is not known."""
    bad, first = bad_samples(record), record.warm_up_samples
    target = Target(
        name=record.name,
        voltage=record.voltage,
        measured=np.ascontiguousarray(record.displacement[first::stride]),
        first=first,
        stride=stride,
        dt=record.dt,
        frequency=record.info.frequency,
        repeats=1,
        noise=nan,
        period=0,
        start=record.start,
        valid=np.where(bad[first::stride], 0.0, 1.0) if np.any(bad) else None,
    )
    return led_in(target, record, begins)


def led_in(target: Target, record: Record, begins: RecordStart) -> Target:
    """Return a target of a whole record with another initial condition."""
    before = lead_in(record, begins)
    return replace(
        target,
        voltage=np.concatenate([before, target.voltage[target.origin :]]),
        first=target.first + before.size - target.origin,
        start=target.start + (target.origin - before.size) * target.dt,
        origin=before.size,
        begins=begins,
    )


def targets_of(
    records: Sequence[Record],
    *,
    folded: bool = True,
    stride: int = 1,
    start: str = 'auto',
    zero: str = 'auto',
    workers: int = 1,
) -> list[Target]:
    """Return the data of a fit: folded where requested and possible, else whole.

    Parameters
    ----------
    records : sequence of Record
        What was measured.
    folded : bool
        Average the periods of records that repeat themselves.
    stride : int
        Every so many samples of a whole record are compared.
    start : str
        How records begin that do not say so themselves, one of `record_start.STARTS`.
    zero : str
        ``record`` counts the displacement of each record from a zero of its own; ``auto`` and
        ``common`` from one for all.
    workers : int
        Threads over the records.
    """

    def seen(record: Record) -> list[Target]:
        noise_of(record)  # which `noises_of` then knows
        parts = fold(record) if folded else []
        return parts or [_of_all_samples(record, stride, first_guess(record, start))]

    found = of_each(seen, records, workers)
    pairs = zip(found, noises_of(records), strict=True)
    targets = [with_noise(each, noise) for parts, noise in pairs for each in parts]
    return [replace(t, own_zero=True) for t in targets] if zero == 'record' else targets
