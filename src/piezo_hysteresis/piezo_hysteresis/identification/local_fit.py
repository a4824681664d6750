"""Local fit of a noisy input that moves a hysteresis as little as it can."""

from __future__ import annotations

from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_least_squares

# Half widths of the windows of a local fit, and deviations within which its estimates agree. The
# remaining error at rest moves a hysteresis all the time: there the windows must be wide.
_WINDOWS = tuple(2**k for k in range(1, 13))
_AGREE = 2.5
_NEAR_TURN = 0.1  # share of the reach about a turn within which a signal is at it


def local_fit(u: FloatArray, noise: float) -> tuple[FloatArray, float]:
    """Return local polynomials over the widest windows that agree with narrower ones, and error.

    Windows before, after and around each sample (Goldenshluger and Nemirovski 1997): a corner or a
    step ends those that would cross it.
    """
    total, weight = np.zeros(u.size), np.zeros(u.size)
    for kind in (-1, 0, 1):
        low, high = u - _AGREE * noise, u + _AGREE * noise  # the sample alone is the first window
        best, variance = u.copy(), np.full(u.size, noise**2)
        going = np.ones(u.size, dtype=bool)
        for half in _WINDOWS:
            if 4 * half > u.size or not np.any(going):
                break
            estimate, valid, gain = _window(u, half, kind)
            spread = noise * sqrt(gain)
            low = np.maximum(low, estimate - _AGREE * spread)
            high = np.minimum(high, estimate + _AGREE * spread)
            going &= valid & (low <= high)
            best = np.where(going, estimate, best)
            variance = np.where(going, spread**2, variance)
        total += best / variance
        weight += 1.0 / variance
    # windows share samples, so their mean is hardly better than the best of them
    own = 2.0 / np.sqrt(weight)
    return _lazy(total / weight, _AGREE * own), float(np.sqrt(np.mean(own**2)))


def _lazy(x: FloatArray, reach: FloatArray) -> FloatArray:
    """Return a signal within `reach` of `x` that moves as little as it can.

    A hysteresis adds up the changes of its input: the remaining noise would move it all the time.
    Of all signals within the reach a play moves least; that of the reversed signal lags in
    the other direction, so that their mean has no lag. What both cut off where the signal turns is
    given back: a hysteresis depends on these values more than on all others.
    """
    low, high = x - reach, x + reach
    forward, backward = np.empty_like(x), np.empty_like(x)
    _follow_tube(low, high, forward)
    _follow_tube(low[::-1].copy(), high[::-1].copy(), backward)
    found = 0.5 * (forward + backward[::-1])
    _restore_turns(x, found.copy(), reach, found)
    return found


@jit
def _restore_turns(x: FloatArray, cut: FloatArray, reach: FloatArray, out: FloatArray) -> None:
    """Stretch the ends of every run of `cut` in one direction to the mean of `x` where it turns.

    Both plays follow a signal to within their reach of its turn, and their mean moves half as
    fast: what is nearer to the turn than it is cut off lay twice as far.
    """
    begin, start, missing_before, before = 0, 0, 0.0, 0.0
    while start < cut.size:
        stop = start + 1
        while stop < cut.size and cut[stop] == cut[start]:
            stop += 1
        up = 1.0 if cut[start] > before else -1.0
        if start > 0 and stop < cut.size and up * (cut[stop] - cut[start]) > 0.0:
            start = stop
            continue
        low, high, near = start, stop, _NEAR_TURN * reach[start]
        while low > begin and abs(cut[low - 1] - cut[start]) < near:
            low -= 1
        while high < cut.size and abs(cut[high] - cut[start]) < near:
            high += 1
        missing = float(np.mean(x[low:high] - cut[low:high]))
        half = 0.5 * abs(cut[start] - before)
        if start > 0 and half > reach[start]:  # a smaller run may be noise
            first, last = -up * missing_before, up * missing
            for k in range(begin, stop):
                out[k] += up * max(min(last, half) - abs(cut[start] - cut[k]), 0.0)
                out[k] -= up * max(min(first, half) - abs(cut[k] - before), 0.0)
        begin, missing_before, before = stop, missing, cut[start]
        start = stop


@jit
def _follow_tube(low: FloatArray, high: FloatArray, out: FloatArray) -> None:
    """Return the signal between `low` and `high` that moves only where one of them pushes it."""
    first, least, most = 0, -np.inf, np.inf
    for k in range(low.size):  # until a value fits no more: the first move
        if max(least, low[k]) > min(most, high[k]):
            break
        least, most, first = max(least, low[k]), min(most, high[k]), k + 1
    value = 0.5 * (least + most)
    if first < low.size:
        value = most if low[first] > most else least
    for k in range(low.size):
        value = min(max(value, low[k]), high[k])
        out[k] = value


def _window(u: FloatArray, half: int, kind: int) -> tuple[FloatArray, BoolArray, float]:
    """Return the local fit at each sample, where its window is inside, and its noise gain."""
    from scipy.signal import oaconvolve

    place = np.arange(-half, half + 1) if kind == 0 else np.arange(0, 2 * half + 1) * float(kind)
    rows = np.vander(place.astype(np.float64) / half, 3 if kind == 0 else 2, increasing=True)
    weights = solve_least_squares(rows.T @ rows, np.eye(rows.shape[1])[0]).values @ rows.T
    first = int(min(place[0], place[-1]))
    ordered = weights if place[0] <= place[-1] else weights[::-1]
    found, valid = u.copy(), np.zeros(u.size, dtype=bool)
    inside = oaconvolve(u, ordered[::-1], mode='valid')
    found[-first : -first + inside.size] = inside
    valid[-first : -first + inside.size] = True
    return found, valid, float(weights @ weights)
