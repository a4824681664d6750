"""Signals for plots: fewer points with all extremes kept, and amplitude spectra."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray

# Number of drawn points: a few per pixel of a screen.
DRAWN = 3000
# Ratio to the largest drawn value from which an omitted value is noted.
_SPIKE = 2.0


def thinned(x: FloatArray, y: FloatArray, points: int = DRAWN) -> tuple[FloatArray, FloatArray]:
    """Return at most `points` points that keep the smallest and largest `y` of every interval.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Coordinates in the order of the line.
    points : int
        Largest number of points, 4 or more.

    Returns
    -------
    tuple of ndarray
        Points of the input in its order, including the first and the last.
    """
    n = y.size
    if n <= points:
        return x, y
    stretches = max((points - 2) // 2, 1)
    edges = np.linspace(0, n, stretches + 1).astype(int)
    keep = {0, n - 1}
    for first, last in pairwise(edges):
        keep.add(first + int(np.argmin(y[first:last])))
        keep.add(first + int(np.argmax(y[first:last])))
    order = np.array(sorted(keep))
    return x[order], y[order]


def envelope(
    x: FloatArray, y: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the starts of `count` intervals with the smallest and largest `y` of each.

    The end of the last interval is repeated, so that a step plot closes. Values that are not
    finite are ignored.
    """
    known = np.isfinite(y)
    x, y = x[known], y[known]
    edges = np.linspace(0, y.size, min(count, y.size) + 1).astype(int)
    low = np.array([y[first:last].min() for first, last in pairwise(edges)])
    high = np.array([y[first:last].max() for first, last in pairwise(edges)])
    starts = np.append(x[edges[:-1]], x[-1:])
    return starts, np.append(low, low[-1:]), np.append(high, high[-1:])


def amplitude_spectrum(signal: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and the amplitude of each line, without the mean.

    A Hann window keeps strong lines from leaking over weak ones; a sine of amplitude 1 on a line
    reads 1.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal in any unit.
    dt : float
        Sampling interval [s].
    """
    # periodic form: whole periods coincide with spectral lines
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(signal.size) / signal.size)
    window /= window.sum()
    # subtracted with the window weights, so that the mean does not leak into the first lines
    centred = signal - float(window @ signal)
    amplitude = 2 * np.abs(np.fft.rfft(centred * window))
    frequencies = np.asarray(np.fft.rfftfreq(signal.size, dt), np.float64)
    return frequencies[1:], np.asarray(amplitude[1:], np.float64)


def last_periods(n: int, frequency: float, dt: float, periods: int, warm_up: int = 0) -> slice:
    """Return the last whole `periods` of `n` samples; without a period all after the warm-up."""
    count = round(periods / (frequency * dt)) if frequency > 0 else n
    return slice(max(n - count - 1, warm_up, 0), n)


def stands_out(whole: FloatArray, part: FloatArray) -> bool:
    """Return whether the whole has much larger values than the drawn part, such as a spike."""
    if not part.size or not np.all(np.isfinite(whole)):
        return False
    return float(np.abs(whole).max()) > _SPIKE * float(np.abs(part).max())
