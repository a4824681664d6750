"""What a fit compares a model with: whole records, or the mean of their periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record

#: Time a model gets to forget its start before a folded period is compared [s].
SETTLING = 3.0
#: Behind the name of a record: its way into the steady state.
WAY_IN = ' (start)'
_REST = 0.05  # first voltage over the largest up to which a record begins at rest
_PERIODIC = 1e-3  # scatter of the voltage over its rms up to which it counts as periodic


@dataclass(frozen=True)
class Target:
    """One record as a fit sees it.

    Attributes
    ----------
    name : str
        Name of the record.
    voltage : ndarray, shape (n,)
        What the model is driven with from rest, up to the last compared sample [V].
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
        Rms scatter of one sample from period to period [m]; NaN where it is not known.
    period : int
        Samples per folded period; 0 where nothing was folded.
    start : float
        Time of the first sample [s], for blocks that depend on it.
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

    @property
    def weight(self) -> float:
        """Factor by which a residual counts, because it stands for `repeats` periods."""
        return sqrt(self.repeats)

    def pick(self, simulated: FloatArray) -> FloatArray:
        """Return the samples of `simulated`, shape (n,), that are compared; shape (m,)."""
        return simulated[self.first :: self.stride]


def period_of(record: Record) -> int:
    """Return the smallest period of the voltage in samples, 0 where it is not periodic.

    Looks at the second half of the record, so that a start-up does not hide the period.
    """
    u = record.voltage[len(record) // 2 :]
    n = u.size
    power = float(np.mean((u - u.mean()) ** 2))
    if n < 8 or power <= 1e-30 * max(1.0, float(np.max(np.abs(u))) ** 2):
        return 0
    centred = u - u.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, size)[:n]
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(1, n // 2 + 1)
    # mean of (u[k+N] - u[k])^2 for every lag N at once
    energy = squares[n - lags] + squares[n] - squares[lags]
    change = (energy - 2 * correlation[lags]) / (n - lags)
    exact = _smallest(centred, lags[change < _PERIODIC**2 * power], 1e-9 * sqrt(power))
    return exact or _smallest(
        centred, lags[change < _PERIODIC**2 * power], _PERIODIC * sqrt(power)
    )


def _smallest(u: FloatArray, lags: FloatArray, limit: float) -> int:
    for lag in lags:
        if sqrt(float(np.mean((u[lag:] - u[:-lag]) ** 2))) < limit:
            return int(lag)
    return 0


def fold(record: Record, settling: float = SETTLING) -> list[Target]:
    """Average the steady periods of a record; return nothing where it has no two of them.

    The way into the steady state is a second target, ``NAME (start)``, where the record begins
    near 0 V, so that folding loses no information; one that begins in motion keeps its unknown
    past to itself.

    A record is steady where the periods, seen from its end, differ by their scatter only. One that
    drifts or creeps through all its periods is not folded, because its mean period is of no
    model.
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
    periods = record.displacement[first:].reshape(count, period)
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
    )
    from_rest = abs(record.voltage[0]) <= _REST * float(np.max(np.abs(record.voltage)))
    if not from_rest or begin - record.warm_up_samples < 2:
        return [mean]
    way_in = replace(
        whole(record),
        name=record.name + WAY_IN,
        voltage=record.voltage[:begin],
        measured=record.displacement[record.warm_up_samples : begin],
    )
    return [mean, way_in]


def periodic_from(u: FloatArray, period: int) -> int:
    """First sample from which the voltage repeats itself to the end."""
    change = np.abs(u[period:] - u[:-period])
    limit = 6 * _PERIODIC * float(np.std(u[u.size // 2 :]))
    broken = np.flatnonzero(change > limit)
    return int(broken[-1]) + 1 if broken.size else 0


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


def whole(record: Record, stride: int = 1) -> Target:
    """Return the record as it is, compared from its warm-up on, at every `stride`-th sample."""
    first = record.warm_up_samples
    return Target(
        name=record.name,
        voltage=record.voltage,
        measured=np.ascontiguousarray(record.displacement[first::stride]),
        first=first,
        stride=stride,
        dt=record.dt,
        frequency=record.info.frequency,
        repeats=1,
        noise=float('nan'),
        period=0,
        start=record.start,
    )


def targets_of(records: Sequence[Record], *, folded: bool = True, stride: int = 1) -> list[Target]:
    """Return what a fit compares with: folded where asked for and possible, else whole."""
    targets = []
    for record in records:
        parts = fold(record) if folded else []
        targets += parts or [whole(record, stride)]
    return targets
