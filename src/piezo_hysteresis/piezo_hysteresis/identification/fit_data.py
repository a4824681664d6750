"""Data of a fit: whole records, or the mean of their periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    measured_without_outliers,
    noise_of,
    noises_of,
)
from piezo_hysteresis.identification.periods import period_of, periodic_from
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.record import InputUncertainty

#: Ticks for which the last voltage is held: the largest sampling offset of a recording.
LEAD_OUT = 2
# Share of the range of the voltage that a mean period covers: a step before it is not lost.
_WHOLE = 0.9
# Smallest number of periods: fewer save no time, and hide a transient in their noise.
_FEWEST = 4
#: Suffix of the name of a record: its transient before the steady state.
WAY_IN = ' (start)'


@dataclass(frozen=True)
class FitData:
    """Data of one record for a fit.

    Attributes
    ----------
    name : str
        Name of the record.
    voltage : ndarray, shape (n,)
        Input of the model from the virgin state at 0 V to the last compared sample [V].
    measured : ndarray, shape (m,)
        Displacement at the samples ``first, first + stride, ...`` [m].
    first, stride : int
        First compared sample, and the step between compared samples.
    dt : float
        Sampling interval [s].
    frequency : float
        Fundamental frequency of the drive [Hz], 0 if there is none.
    repeats : int
        Number of periods averaged in `measured`; 1 for a whole record.
    noise : float
        Rms noise of one sample [m], see `noise.noises_of`; NaN if unknown.
    noise_colour : float
        Correlation of its noise from one compared sample to the next; 0 for white noise.
    rounding : float
        Relative uncertainty of the mean square of its noise, see `noise.Noise`.
    period : int
        Samples per folded period; 0 for a whole record.
    start : float
        Time of the first driven sample [s], for blocks that depend on it.
    origin : int
        Driven sample at which the record begins; the samples before it are the lead-in.
    begins : RecordStart
        Initial condition.
    own_zero : bool
        Whether the record has its own zero of the displacement.
    precision : float
        Weight of its residual in addition to that of its repeats: the precision of one sample
        relative to the other targets.
    valid : ndarray, shape (m,), or None
        1 for a valid compared sample, 0 for a spike or a lost one; None if all are valid.
    influence : ndarray, shape (m,), or None
        Weight of each residual in a fit, less than 1 for outliers; None if all are 1.
    input_uncertainty : InputUncertainty or None
        Error of its input, if that was measured.
    shared : (ndarray, ndarray) or None
        Derivatives by the nuisance parameters of the record, shape (q, m), and the weights of
        their prior, of another model; None if each model determines its own.
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
    input_uncertainty: InputUncertainty | None = None
    shared: tuple[FloatArray, FloatArray] | None = None

    @property
    def weight(self) -> float:
        """Weight of a residual, from the number of averaged periods and the noise."""
        return sqrt(self.repeats) * self.precision

    @property
    def excess_deviation(self) -> float:
        """Relative standard deviation of the mean square of the noise."""
        numbers = independent(self.measured.size, self.noise_colour)
        return hypot(sqrt(2.0 / numbers), self.rounding / SURE)

    @property
    def lost(self) -> int:
        """Number of invalid samples."""
        return 0 if self.valid is None else int(self.valid.size - self.valid.sum())

    @property
    def factors(self) -> FloatArray | None:
        """Weight of each residual in a fit: its influence, 0 if it is lost; None for 1."""
        if self.valid is None or self.influence is None:
            return self.influence if self.valid is None else self.valid
        return self.valid * self.influence

    def begins_like(self, other: FitData) -> bool:
        """Return whether two targets have the same initial condition and kind of zero."""
        return self.begins == other.begins and self.own_zero == other.own_zero

    def kept(self, samples: FloatArray) -> FloatArray:
        """Return the valid compared samples, shape (m,)."""
        return samples if self.valid is None else samples[self.valid > 0.0]

    @property
    def drive(self) -> FloatArray:
        """Voltage with its last value held for two ticks, shape (n + 2,) [V]; a copy each time."""
        return np.concatenate([self.voltage, np.repeat(self.voltage[-1:], LEAD_OUT)])

    @property
    def compared(self) -> slice:
        """Slice of the driven samples that are compared."""
        return slice(self.first, self.voltage.size, self.stride)

    def compared_in(self, first: int, last: int) -> tuple[slice, slice]:
        """Return which compared samples are among the driven ones of a part, and where in it."""
        begin = max(0, -((self.first - first) // self.stride))
        end = min(max(begin, -((self.first - last) // self.stride)), self.measured.size)
        place = self.first + begin * self.stride - first
        return slice(begin, end), slice(place, last - first, self.stride)

    def pick(self, simulated: FloatArray) -> FloatArray:
        """Return the compared samples of a response, shape (n,) or (n + 2,); shape (m,)."""
        return simulated[self.compared]


def fold(record: Record, settling: float = SETTLING) -> list[FitData]:
    """Average the steady periods of a record; return nothing if there are too few.

    The transient before the steady state is a second target, ``NAME (start)``, where the record
    begins near 0 V, so that folding loses no information. The transient of a record that begins
    in motion depends on an unknown history and is omitted.

    A record is steady where its last periods differ only by noise. A record that drifts or creeps
    over all periods is not folded, because no model has such a mean period.
    """
    period = period_of(record)
    if period == 0 or len(record) < _FEWEST * period:
        return []
    if np.ptp(record.voltage[-period:]) < _WHOLE * np.ptp(record.voltage):
        return []
    same = periodic_from(record.voltage, period)
    first = max(same, record.warm_up_samples)
    count = (len(record) - first) // period
    if count < 2:
        return []
    first = len(record) - count * period
    measured = measured_without_outliers(record)
    periods = measured[first:].reshape(count, period)
    steady = _steady(periods)
    if steady is None:
        return []
    start, noise = steady
    kept = periods[start:]
    begin = first + start * period
    voltage, offset = _drive(record, period, begin, settling)
    mean = FitData(
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
        input_uncertainty=record.input_uncertainty,
    )
    from_rest = abs(record.voltage[0]) <= NEAR_ZERO * float(np.max(np.abs(record.voltage)))
    if not from_rest or begin - record.warm_up_samples < 2:
        return [mean]
    way_in = _of_all_samples(record.section(0, begin), 1, STEP)
    return [mean, replace(way_in, name=record.name + WAY_IN, noise=noise)]


def _steady(periods: FloatArray) -> tuple[int, float] | None:
    """Return the first steady period and the noise of one sample, None for fewer than two."""
    count, samples = periods.shape
    tail = periods[count // 2 :] if count >= 4 else periods[-2:]
    mean = tail.mean(axis=0)
    scatter = sqrt(float(np.sum((tail - mean) ** 2)) / ((len(tail) - 1) * samples))
    # the rms of short periods varies more
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
    """Return the voltage from the start over enough periods, and the start of the last one."""
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


def with_noise(target: FitData, noise: Noise) -> FitData:
    """Return a target with a noise estimated from several records."""
    colour = noise.memory**target.stride
    return replace(target, noise=noise.rms, noise_colour=colour, rounding=noise.rounding)


def whole(record: Record, stride: int = 1, begins: RecordStart = STEP) -> FitData:
    """Return the whole record, compared after its warm-up at every `stride`-th sample."""
    return with_noise(_of_all_samples(record, stride, begins), noise_of(record))


def _of_all_samples(record: Record, stride: int, begins: RecordStart) -> FitData:
    """Return the target of a whole record, with unknown noise."""
    bad, first = bad_samples(record), record.warm_up_samples
    target = FitData(
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
        input_uncertainty=record.input_uncertainty,
    )
    return led_in(target, record, begins)


def led_in(target: FitData, record: Record, begins: RecordStart) -> FitData:
    """Return a target of a whole record with another initial condition."""
    return _after(lead_in(record, begins), target, begins)


def with_start_of(target: FitData, other: FitData) -> FitData:
    """Return a target with the initial condition and kind of zero of another part of its record.

    The lead-in is that of `other`: a part may be settled in a cycle that the whole record lacks.
    """
    led = _after(other.voltage[: other.origin], target, other.begins)
    return replace(led, own_zero=other.own_zero)


def _after(before: FloatArray, target: FitData, begins: RecordStart) -> FitData:
    """Return a target whose lead-in is the voltage `before`."""
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
) -> list[FitData]:
    """Return the data of a fit: folded where requested and possible, else whole.

    Parameters
    ----------
    records : sequence of Record
        Measured records.
    folded : bool
        Average the periods of periodic records.
    stride : int
        Step between compared samples of a whole record.
    start : str
        Initial condition of records that do not state one, one of `stated.STARTS`.
    zero : str
        ``record``: each record has its own zero of the displacement; ``auto`` and ``common``: one
        zero for all.
    workers : int
        Threads over the records.
    """

    def seen(record: Record) -> list[FitData]:
        noise_of(record)  # `noises_of` then uses it
        parts = fold(record) if folded else []
        return parts or [_of_all_samples(record, stride, first_guess(record, start))]

    found = of_each(seen, records, workers)
    pairs = zip(found, noises_of(records), strict=True)
    targets = [with_noise(each, noise) for parts, noise in pairs for each in parts]
    return [replace(t, own_zero=True) for t in targets] if zero == 'record' else targets
