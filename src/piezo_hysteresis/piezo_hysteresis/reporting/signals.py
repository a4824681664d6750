"""Signals for plots: fewer points with all extremes kept, and amplitude spectra."""

from __future__ import annotations

from heapq import heappop, heappush
from itertools import pairwise

import numpy as np
from scipy.fft import rfft

from piezo_hysteresis.arrays import FloatArray, IntArray

# Number of drawn points: a few per pixel of a screen.
DRAWN = 3000
# Distance from the drawn line that is less than a pixel, relative to the spans of both axes.
_UNSEEN = 5e-4
# Ratio to the largest drawn value from which an omitted value is noted.
_SPIKE = 2.0


def thinned(
    x: FloatArray, y: FloatArray, points: int = DRAWN, *, decades: bool = False
) -> tuple[FloatArray, FloatArray]:  # x, y (n,)
    """Return at most `points` points of a line that look like the whole line.

    Over increasing `x`, such as time, the smallest and largest `y` of every interval are kept. A
    path in the plane, such as a loop, keeps the points farthest from the drawn line, and thus the
    turning points of both axes (Ramer 1972; Douglas and Peucker 1973).
    """
    if y.size <= points:
        return x, y
    order = _extremes(y, points, decades) if np.all(np.diff(x) > 0.0) else _corners(x, y, points)
    return x[order], y[order]


def _extremes(y: FloatArray, points: int, decades: bool) -> IntArray:
    """Return the places of the smallest and largest value of every interval, and of the ends."""
    n = y.size
    stretches = max((points - 2) // 2, 1)
    edges = np.linspace(0, n, stretches + 1).astype(int)
    if decades:
        edges = np.unique(np.geomspace(1, n, stretches + 1).astype(int)) - 1
    keep = {0, n - 1}
    for first, last in pairwise(edges):
        keep.add(first + int(np.argmin(y[first:last])))
        keep.add(first + int(np.argmax(y[first:last])))
    return np.array(sorted(keep), np.int64)


def _corners(x: FloatArray, y: FloatArray, points: int) -> IntArray:
    """Return the places of the corners of a path, those farthest from the drawn line first."""
    place = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if place.size <= points:
        return place
    plane = np.column_stack([x[place], y[place]])
    span = np.ptp(plane, axis=0)
    plane = (plane - plane[0]) / np.where(span > 0.0, span, 1.0)
    keep = [0, place.size - 1]
    open_ = [_farthest(plane, 0, place.size - 1)]
    while open_ and len(keep) < points and -open_[0][0] > _UNSEEN:
        _, middle, first, last = heappop(open_)
        keep.append(middle)
        for ends in ((first, middle), (middle, last)):
            if ends[1] - ends[0] > 1:
                heappush(open_, _farthest(plane, *ends))
    return np.asarray(place[np.sort(keep)], np.int64)


def _farthest(plane: FloatArray, first: int, last: int) -> tuple[float, int, int, int]:
    """Return the negative distance of the point farthest from a chord, its place and the ends."""
    away = plane[first + 1 : last] - plane[first]
    chord = plane[last] - plane[first]
    length = float(chord @ chord)
    along = np.clip(away @ chord / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(away))
    distance = np.hypot(*(away - along[:, None] * chord).T)
    middle = int(np.argmax(distance))
    return -float(distance[middle]), first + 1 + middle, first, last


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
    """
    # signal (n,); dt [s]
    # periodic form: whole periods coincide with spectral lines; in place, for long records
    window = np.arange(signal.size, dtype=np.float64)
    window *= 2 * np.pi / signal.size
    np.cos(window, out=window)
    np.subtract(1.0, window, out=window)
    window /= window.sum()
    # subtracted with the window weights, so that the mean does not leak into the first lines
    window *= signal - float(window @ signal)
    amplitude = np.abs(rfft(window, overwrite_x=True))
    amplitude *= 2.0
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
