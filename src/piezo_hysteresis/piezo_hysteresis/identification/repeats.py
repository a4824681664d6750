"""Difference of a signal from the previous period of the drive, also for fractional periods.

The period need not be a whole number of samples, and a record may begin with a ramp or contain a
jump. The period is therefore a real number, the signal is interpolated one period earlier, and
only the longest section with a periodic drive is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.periods import (
    PERIODIC,
    cached_per_record,
    like_lags,
    mean_changes,
)
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

# Interpolation taps on either side, and the parameter of their window.
_HALF, _SHAPE = 24, 7.0
# Relative power of the difference at a whole number of samples up to which a drive may be periodic
# with a fractional period, while a tenth of the record is not.
_NEAR = 0.25
# Largest number of fractional lags that are tested.
_TRIED = 12
# Smallest number of periods of a section, including the first.
_PERIODS = 2.0
# Search range of the period in samples and as a share of a lag, and its tolerance.
_BESIDE, _MOVED, _EXACT = 0.75, 0.02, {'xatol': 1e-7}
# Samples, and share of a period, over which an interpolated corner is not a break.
_CORNER, _CORNER_SHARE = 21, 0.12


@dataclass(frozen=True)
class Repeat:
    """The section of a record in which the drive is periodic."""

    period: float  # period in samples, possibly fractional
    first: int  # first sample of the section
    last: int  # the sample after its last

    def shows_from(self, sample: int) -> bool:
        """Return whether the section after a sample is long enough for a difference of periods."""
        left = self.last - max(self.first, sample)
        return left >= max(_PERIODS * self.period, 4 * _HALF)


@cached_per_record
def repeat_of(record: Record) -> Repeat | None:
    """Return the longest section with a periodic drive, None if there is none."""
    u = record.voltage
    spread = float(np.std(u))
    if u.size < 4 * _HALF or spread <= 1e-15 * float(np.max(np.abs(u))):
        return None
    for lag in like_lags(mean_changes(u), spread**2, 2.0 * _NEAR)[:_TRIED]:
        period = _refined(u, lag)
        found = _longest(u, period, spread)
        if found is not None:
            return found
    return None


def less_the_period_before(signal: FloatArray, period: float) -> FloatArray:
    """Return ``signal(k) - signal(k - period)`` where both are available, shape (m,)."""
    taps, lag = _taps(period)
    before = np.convolve(signal, taps, mode='valid')
    # before[i] is the signal at i + _HALF - (period - lag)
    first = lag + _HALF
    count = min(before.size, signal.size - first)
    return np.asarray(signal[first : first + count] - before[:count], dtype=np.float64)


def gain_of_difference(window: FloatArray, period: float) -> FloatArray:  # window (n,)
    """Return the mean square of every line of a windowed difference, for white noise of rms 1."""
    taps, lag = _taps(period)
    placed = np.zeros(window.size)
    np.add.at(placed, (lag - _HALF + np.arange(taps.size)) % window.size, taps)
    before = np.fft.rfft(placed)
    shared = inner(window[lag:], window[:-lag]) if lag < window.size else 0.0
    alike = shared / inner(window, window)
    return np.asarray(1.0 + np.abs(before) ** 2 - 2.0 * alike * before.real)


def _taps(period: float) -> tuple[FloatArray, int]:
    lag = round(period)
    place = np.arange(-_HALF, _HALF + 1) - (period - lag)
    taps = np.sinc(place) * np.kaiser(2 * _HALF + 1, _SHAPE)
    return np.asarray(taps / taps.sum()), lag


def _refined(u: FloatArray, lag: int) -> float:
    """Return the fractional period near a whole lag that fits the longest part of the drive."""

    def change(period: float) -> float:
        return float(np.median(np.abs(less_the_period_before(u, period))))

    def best(width: float) -> float:
        bounds = (lag - width, lag + width)
        return float(minimize_scalar(change, bounds=bounds, method='bounded', options=_EXACT).x)

    # a jump shifts the minimum by which the lag was found
    return min((best(width) for width in (_BESIDE, _BESIDE + _MOVED * lag)), key=change)


def _longest(u: FloatArray, period: float, spread: float) -> Repeat | None:
    change = np.abs(less_the_period_before(u, period))
    width = max(3, min(_CORNER, int(_CORNER_SHARE * period)) | 1)
    broken = median_filter(change, width, mode='nearest') > 6.0 * PERIODIC * spread
    edges = np.flatnonzero(np.concatenate([[True], broken, [True]]))
    longest = int(np.argmax(np.diff(edges)))
    begin, end = int(edges[longest]), int(edges[longest + 1]) - 1
    # change[i] compares sample i + lag + _HALF with the value one period earlier
    first, last = begin, end + round(period) + _HALF
    return Repeat(period, first, last) if last - first >= _PERIODS * period else None
