"""A signal less what it was one period of the drive before, also where no sample falls on one.

A period need not be a whole number of samples, and a record may begin with a ramp or hold a jump.
So the period is a real number, what was there a period ago is read between samples, and only the
longest stretch over which the drive does repeat is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.periods import PERIODIC, cached_per_record
from piezo_hysteresis.records import Record

# Taps to either side between which a signal is read, and the window that ends them.
_HALF, _SHAPE = 24, 7.0
# Share of its power by which a drive may differ from what it was a whole number of samples before,
# where it repeats between them and a tenth of the record is another.
_NEAR = 0.25
# Lags that are looked at between samples, at most.
_TRIED = 12
# Least periods of a stretch: one is the first, which nothing precedes.
_PERIODS = 2.0
# Samples, and share of a lag besides, within which the period is looked for, and how well.
_BESIDE, _MOVED, _EXACT = 0.75, 0.02, {'xatol': 1e-7}
# Samples, and share of a period, within which a corner, read between samples, is no break.
_CORNER, _CORNER_SHARE = 21, 0.12


@dataclass(frozen=True)
class Repeat:
    """The stretch in which the drive of a record repeats.

    Attributes
    ----------
    period : float
        In samples; need not be whole.
    first, last : int
        Samples of the stretch, the end excluded.
    """

    period: float
    first: int
    last: int

    def shows_from(self, sample: int) -> bool:
        """Return whether enough of the stretch lies behind a sample to be compared with itself."""
        left = self.last - max(self.first, sample)
        return left >= max(_PERIODS * self.period, 4 * _HALF)


@cached_per_record
def repeat_of(record: Record) -> Repeat | None:
    """Return the longest stretch in which the drive repeats, None where there is none."""
    u = record.voltage
    spread = float(np.std(u))
    if u.size < 4 * _HALF or spread <= 1e-15 * max(1.0, float(np.max(np.abs(u)))):
        return None
    for lag in _near_lags(u - u.mean(), spread):
        period = _refined(u, lag)
        found = _longest(u, period, spread)
        if found is not None:
            return found
    return None


def less_the_period_before(signal: FloatArray, period: float) -> FloatArray:
    """Return ``signal(k) - signal(k - period)`` wherever both are known, shape (m,)."""
    taps, lag = _taps(period)
    before = np.convolve(signal, taps, mode='valid')
    # before[i] is the signal at i + _HALF - (period - lag)
    first = lag + _HALF
    count = min(before.size, signal.size - first)
    return np.asarray(signal[first : first + count] - before[:count], dtype=np.float64)


def gain_of_difference(window: FloatArray, period: float) -> FloatArray:
    """Return the mean square of every line of a windowed difference, for white noise of rms 1.

    Parameters
    ----------
    window : ndarray, shape (n,)
        Weight of each sample of the difference.
    period : float
        Samples after which the signal was subtracted from itself.
    """
    taps, lag = _taps(period)
    placed = np.zeros(window.size)
    np.add.at(placed, (lag - _HALF + np.arange(taps.size)) % window.size, taps)
    before = np.fft.rfft(placed)
    shared = float(window[lag:] @ window[:-lag]) if lag < window.size else 0.0
    alike = shared / float(window @ window)
    return np.asarray(1.0 + np.abs(before) ** 2 - 2.0 * alike * before.real)


def _taps(period: float) -> tuple[FloatArray, int]:
    lag = round(period)
    place = np.arange(-_HALF, _HALF + 1) - (period - lag)
    taps = np.sinc(place) * np.kaiser(2 * _HALF + 1, _SHAPE)
    return np.asarray(taps / taps.sum()), lag


def _near_lags(centred: FloatArray, spread: float) -> list[int]:
    """Return whole lags near which the drive may repeat, the smallest first."""
    n = centred.size
    spectrum = np.fft.rfft(centred, 1 << (2 * n - 1).bit_length())
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(1, int(n / _PERIODS) + 1)
    change = (squares[n - lags] + squares[n] - squares[lags] - 2 * correlation[lags]) / (n - lags)
    inner = change[1:-1]
    dips = 1 + np.flatnonzero((inner < change[:-2]) & (inner < change[2:]))
    return [int(lags[k]) for k in dips if change[k] < 2.0 * _NEAR * spread**2][:_TRIED]


def _refined(u: FloatArray, lag: int) -> float:
    """Return the period near a whole number of samples at which most of the drive repeats."""

    def change(period: float) -> float:
        return float(np.median(np.abs(less_the_period_before(u, period))))

    def best(width: float) -> float:
        bounds = (lag - width, lag + width)
        return float(minimize_scalar(change, bounds=bounds, method='bounded', options=_EXACT).x)

    # a jump moves the dip by which the lag was found
    return min((best(width) for width in (_BESIDE, _BESIDE + _MOVED * lag)), key=change)


def _longest(u: FloatArray, period: float, spread: float) -> Repeat | None:
    change = np.abs(less_the_period_before(u, period))
    width = max(3, min(_CORNER, int(_CORNER_SHARE * period)) | 1)
    broken = median_filter(change, width, mode='nearest') > 6.0 * PERIODIC * spread
    edges = np.flatnonzero(np.concatenate([[True], broken, [True]]))
    longest = int(np.argmax(np.diff(edges)))
    begin, end = int(edges[longest]), int(edges[longest + 1]) - 1
    # change[i] compares sample i + lag + _HALF with what was a period before
    first, last = begin, end + round(period) + _HALF
    return Repeat(period, first, last) if last - first >= _PERIODS * period else None
