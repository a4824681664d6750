"""Signals made fit for drawing: fewer points with every extreme kept, and amplitude spectra."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray

# A screen shows no more than a few points per pixel.
DRAWN = 3000
# Beyond so many times the largest value that is drawn, one that is not is missed.
_SPIKE = 2.0


def thinned(x: FloatArray, y: FloatArray, points: int = DRAWN) -> tuple[FloatArray, FloatArray]:
    """Return at most `points` points that keep the smallest and largest `y` of every stretch.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        In the order in which they are joined.
    points : int
        How many to keep at most, 4 or more.

    Returns
    -------
    tuple of ndarray
        Points of the input, in its order, the first and the last among them.
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
        In any unit.
    dt : float
        Sampling interval [s].
    """
    # periodic form: whole periods then fall on whole lines
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(signal.size) / signal.size)
    window /= window.sum()
    # taken off with the window's weights, so that nothing of the mean leaks into the first lines
    centred = signal - float(window @ signal)
    amplitude = 2 * np.abs(np.fft.rfft(centred * window))
    frequencies = np.asarray(np.fft.rfftfreq(signal.size, dt), np.float64)
    return frequencies[1:], np.asarray(amplitude[1:], np.float64)


def last_periods(n: int, frequency: float, dt: float, periods: int, warm_up: int = 0) -> slice:
    """Return the last whole `periods` of `n` samples, or all behind the warm-up without one."""
    count = round(periods / (frequency * dt)) if frequency > 0 else n
    return slice(max(n - count - 1, warm_up, 0), n)


def stands_out(whole: FloatArray, part: FloatArray) -> bool:
    """Return whether a part hides the largest values of the whole, as of a spike elsewhere."""
    if not part.size or not np.all(np.isfinite(whole)):
        return False
    return float(np.abs(whole).max()) > _SPIKE * float(np.abs(part).max())
