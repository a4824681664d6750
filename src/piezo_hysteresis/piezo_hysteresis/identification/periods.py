"""Periods of records, and the lag between the ways of a scan."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.outliers import runs_of
from piezo_hysteresis.numerics.harmonics import autocorrelation
from piezo_hysteresis.records import Record

Result = TypeVar('Result')

#: Difference of the voltage a period apart, over its rms, up to which it is periodic.
PERIODIC = 1e-3
# Square of that difference, over the power, near a period of a fractional number of samples.
_NEARLY = 0.1
# Share of the power in the strongest line from which one frequency dominates, and mean square of
# the difference a period apart over that half a period apart up to which it has periods.
_DOMINANT, _ALIKE = 0.8, 0.5


def cached_per_record(function: Callable[[Record], Result]) -> Callable[[Record], Result]:
    """Return `function` with its result cached per record; records are immutable."""
    known: WeakKeyDictionary[Record, Result] = WeakKeyDictionary()

    def cached(record: Record) -> Result:
        if record not in known:
            known[record] = function(record)
        return known[record]

    cached.__doc__ = function.__doc__
    return cached


@cached_per_record
def period_of(record: Record) -> int:
    """Return the smallest period of the voltage in samples, 0 if it is not periodic.

    The end of the record must be periodic for half of it, for three quarters, or from its first
    sample, so that a start-up does not hide the period.
    """
    u = record.voltage
    for first in (u.size // 2, u.size // 4, 0):
        period = _whole_period(u[first:], several=first == u.size // 2)
        if period:
            return period
    return 0


def _whole_period(u: FloatArray, *, several: bool) -> int:
    """Return the smallest whole period of a signal all of whose periods are alike, or 0.

    Where `several` is false, multiples of a fractional period do not count.
    """
    change, power = mean_changes(u), float(np.var(u))
    lags = like_lags(change, power, PERIODIC**2)
    if not several:
        lags = [lag for lag in like_lags(change, power, _NEARLY)[:1] if lag in lags]
    for lag in lags:
        # a part of a sample by which the period is wrong adds up from period to period
        if float(np.max(change[lag - 1 :: lag])) < PERIODIC**2 * power:
            return lag
    return 0


def like_lags(change: FloatArray, power: float, share: float) -> list[int]:  # change (m,)
    """Return lags at which a signal resembles itself and in between does not, smallest first.

    Half a period apart a periodic signal differs by more than its power, a period apart by less
    than a `share` of it. A slow signal resembles itself from each sample to the next, which is
    no period.
    """
    differs = np.flatnonzero(change > power)
    if not differs.size or not power > 0.0:
        return []
    alike = change < share * power
    alike[: differs[0]] = False
    return [int(first + np.argmin(change[first:last])) + 1 for first, last in runs_of(alike)]


def mean_changes(signal: FloatArray) -> FloatArray:
    """Return the mean square of ``x(k + lag) - x(k)`` for the lags 1 to n // 2 of a signal."""
    n = signal.size
    most = n // 2
    centred = signal - signal.mean()
    change = -2.0 * autocorrelation(centred)[1 : most + 1]
    np.square(centred, out=centred)
    squares = np.cumsum(centred, out=centred)
    change += squares[::-1][1 : most + 1]
    change += squares[-1]
    change -= squares[:most]
    change /= np.arange(n - 1, n - 1 - most, -1.0)
    return np.asarray(change)


def periodic_from(u: FloatArray, period: int) -> int:
    """Return the first sample from which the voltage is periodic to the end."""
    change = np.abs(u[period:] - u[:-period])
    limit = 6 * PERIODIC * float(np.std(u[u.size // 2 :]))
    broken = np.flatnonzero(change > limit)
    return int(broken[-1]) + 1 if broken.size else 0


@cached_per_record
def main_frequency(record: Record) -> float:
    """Return the frequency [Hz] of a drive that one frequency dominates, also as its size varies.

    It is 0 for any other drive: two successive periods must be more alike than half periods.
    """
    u = record.voltage - record.voltage.mean()
    power = np.abs(np.fft.rfft(u * np.hanning(u.size))) ** 2
    peak = int(np.argmax(power))
    if peak < 1 or float(power[max(peak - 2, 0) : peak + 3].sum()) < _DOMINANT * power.sum():
        return 0.0
    frequency = _between_lines(u, record.dt, peak)
    half, period = round(0.5 / (frequency * record.dt)), round(1.0 / (frequency * record.dt))
    if 2 * period > u.size or _change(u, period) > _ALIKE * _change(u, max(half, 1)):
        return 0.0
    whole = period_of(record) * record.dt
    # the leakage of few periods shifts the line; a whole period is exact
    return round(frequency * whole) / whole if whole else frequency


def _change(u: FloatArray, lag: int) -> float:
    return float(np.mean((u[lag:] - u[:-lag]) ** 2))


def _between_lines(u: FloatArray, dt: float, peak: int) -> float:
    """Return where the windowed spectrum of a signal is largest near one of its lines [Hz].

    With a frequency that is half a line off, the phase of its harmonics drifts over the record.
    """
    from scipy.optimize import minimize_scalar

    windowed = u * np.hanning(u.size)
    turn = -2j * np.pi * np.arange(u.size) / u.size

    def size(place: float) -> float:
        return -float(np.abs(windowed @ np.exp(place * turn)))

    found = minimize_scalar(size, bounds=(peak - 1.0, peak + 1.0), method='bounded')
    return float(found.x) / (u.size * dt)


# Part of the voltage range in which the ways are compared: behind the transients of the corners.
_LOW, _HIGH = 0.25, 0.75
_FEWEST = 4  # samples of a way in that part
# The first cycle differs if it does so by this many standard deviations of the others, and by
# this share of the stroke.
_SURE, _WORTH = 4.0, 0.002


@dataclass(frozen=True)
class TwoWayLag:
    """By how much the way down lies above the way up at equal voltage.

    Attributes
    ----------
    record : str
        Name of the record.
    difference_m : float
        Mean over the middle half of the voltage range and over the cycles behind the first one, or
        over the only one [m].
    share : float
        The same as a share of the stroke.
    delay_s : float
        Time by which both ways lag, if a pure delay makes this difference [s].
    first_cycle_m : float or None
        The difference of the first cycle where it differs from the others [m].
    """

    record: str
    difference_m: float
    share: float
    delay_s: float
    first_cycle_m: float | None

    def __str__(self) -> str:
        text = (
            f'{self.record}: {1e6 * self.difference_m:.3g} µm ({100 * self.share:.3g} % of the '
            f'stroke, as by a delay of {1e3 * self.delay_s:.3g} ms)'
        )
        if self.first_cycle_m is None:
            return text
        return f'{text}, first cycle {1e6 * self.first_cycle_m:.3g} µm'


def two_way_lag(record: Record) -> TwoWayLag | None:
    """Return the difference between the ways of a scan; None without a way up and a way down."""
    u, y = record.voltage, record.displacement
    low, span, stroke = float(u.min()), float(np.ptp(u)), float(np.ptp(y))
    if not (span > 0.0 and stroke > 0.0 and np.all(np.isfinite(y))):
        return None
    place = (u - low) / span
    ways = list(_ways(place))
    if len(ways) < 2:
        return None
    # the first way may be that from rest, whose slope and stroke are others
    later_ways = [k for k, _ in ways[1:]] if len(ways) > 2 else [k for k, _ in ways]
    stroke = float(np.ptp(y[later_ways[0].start :]))
    slope = _common_slope([place[k] for k in later_ways], [y[k] for k in later_ways])
    heights = [float(np.mean(y[k] - slope * place[k])) for k, _ in ways]
    sign = np.sign(slope)
    cycles = np.array(
        [sign * (b - a) * up for (a, b), (_, up) in zip(pairwise(heights), ways, strict=False)]
    )
    later = cycles[1:] if cycles.size > 1 else cycles
    difference = float(np.mean(later))
    speed = float(np.mean([abs(np.ptp(place[k])) / (place[k].size - 1) for k in later_ways]))
    delay = difference * record.dt / (2 * abs(slope) * speed)
    first = None
    if later.size > 1:
        limit = max(_SURE * float(np.std(later, ddof=1)), _WORTH * stroke)
        first = float(cycles[0]) if abs(cycles[0] - difference) > limit else None
    return TwoWayLag(record.name, difference, difference / stroke, delay, first)


def _ways(place: FloatArray) -> Iterator[tuple[slice, int]]:
    """Yield the samples of every way between the outer quarters of the range, and 1 if upward."""
    side = np.where(place < _LOW, -1, np.where(place > _HIGH, 1, 0))
    outer = np.flatnonzero(side)
    for k in np.flatnonzero(np.diff(side[outer])):
        inside = slice(int(outer[k]) + 1, int(outer[k + 1]))
        if inside.stop - inside.start >= _FEWEST:
            yield inside, int(side[outer[k + 1]])


def _common_slope(places: list[FloatArray], heights: list[FloatArray]) -> float:
    """Return the slope that all ways share, each with a height of its own [m]."""
    x = np.concatenate([each - each.mean() for each in places])
    z = np.concatenate([each - each.mean() for each in heights])
    return float(x @ z / (x @ x))
