"""Detection of outliers: spikes, and drop-outs of the sensor or of the recorder."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.jit import jit, leaf

# Robust standard deviations from which a sample is an outlier.
_FAR = 8.0
_MAD = 1.4826  # of a normal distribution: standard deviation over the median absolute deviation
# A short excursion is an outlier if it is this factor larger than all others nearby.
_STANDS_OUT = 5.0
_NEARBY = 15
_WIDEST = 3  # longest excursion that is detected without a second period, in samples
_FROZEN = 4  # number of samples for which a reading may be constant by chance
_SETTLING = 3.0  # typical difference of a transient period, over that of most
_SMALLEST = 1e-5  # share of the stroke below which no sample is an outlier
_SAME = 1e-9  # share of the stroke within which two readings are the same
_OFF_GRID = 1e-6  # share of a step by which rounding moves a reading off a whole step
_FEWEST_PERIODS = 3  # smallest number of periods whose median is robust to one outlier


def outliers(displacement: FloatArray, period: int, first: int = 0) -> BoolArray:
    """Return which samples are spikes or drop-outs, shape (n,).

    Periods are compared with their median, phase by phase; aperiodic records are checked for
    excursions of a few samples that return to their origin, and for a reading that jumps, is
    constant and jumps back. Neither test depends on the actuator.

    Parameters
    ----------
    displacement : ndarray, shape (n,)
        Measured [m].
    period : int
        Samples per period of the drive; 0 where it does not repeat.
    first : int
        Sample from which it repeats.
    """
    found = excursions(displacement) | frozen(displacement)
    count = (displacement.size - first) // period if period else 0
    if count >= _FEWEST_PERIODS:
        begin = displacement.size - count * period
        found[begin:] |= _unlike(displacement[begin:].reshape(count, period)).ravel()
    return found


def _unlike(periods: FloatArray) -> BoolArray:
    """Return which samples differ from those of the same phase, shape (count, period)."""
    left = periods - np.median(periods, axis=0)
    left -= np.median(left, axis=1, keepdims=True)  # a drift from period to period is no outlier
    size = np.abs(left)
    typical = np.median(size, axis=1, keepdims=True)
    # if most samples of a coarse sensor repeat exactly, its steps are the usual deviation
    usual = max(float(np.median(typical)), _SMALLEST * float(np.ptp(periods)))
    usual = max(usual, 0.5 * step_of(periods.ravel(), negligible=2.0 * usual))
    # a period within the transient differs everywhere from the others: these are no outliers
    return np.asarray((size > _FAR * _MAD * usual) & (typical < _SETTLING * usual))


def step_of(
    y: FloatArray, *, same: float = _SAME, fewest: int = 2, negligible: float = 0.0
) -> float:
    """Return the smallest difference between two readings [m]: the step of a coarse sensor.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Readings [m].
    same : float
        Share of the stroke within which two readings are the same.
    fewest : int
        Number of different readings below which there is no step, and 0 is returned.
    negligible : float
        Size [m] of a step without effect: if consecutive readings differ by so little, their
        smallest difference is returned.
    """
    least = same * float(np.ptp(y))

    def differences(readings: FloatArray) -> FloatArray:
        size = np.abs(np.diff(readings))
        return size[size > least]

    nearest = float(differences(y).min(initial=np.inf))
    if nearest <= negligible or _levels(y, nearest) >= fewest:
        return nearest
    steps = differences(np.sort(y))  # ten times as slow as the tests above
    return float(steps.min()) if steps.size >= max(fewest - 1, 1) else 0.0


def _levels(y: FloatArray, step: float) -> int:
    """Return the number of different readings if they are whole steps apart, else 0."""
    place = (y - y.min()) / step
    whole = np.rint(place)
    if float(whole.max()) > y.size or float(np.abs(place - whole).max()) > _OFF_GRID:
        return 0
    return int(np.count_nonzero(np.bincount(whole.astype(np.intp))))


def excursions(y: FloatArray) -> BoolArray:
    """Return which samples deviate from their neighbours for one to three samples."""
    found = np.zeros(y.size, dtype=bool)
    for width in range(1, _WIDEST + 1):
        if y.size < 2 * _NEARBY:
            break
        _mark_excursions(np.ascontiguousarray(y), width, found)
    return found


@leaf
def _away(y: FloatArray, k: int, width: int) -> tuple[float, float, bool]:
    """Return smallest and largest deviation of `width` samples after `k`, and if of one sign."""
    slope = (y[k + width + 1] - y[k]) / (width + 1)
    least = most = abs(y[k + 1] - (y[k] + slope))
    up = down = 0
    for i in range(1, width + 1):
        off = y[k + i] - (y[k] + i * slope)
        least, most = min(least, abs(off)), max(most, abs(off))
        up += off > 0.0
        down += off < 0.0
    return least, most, width in (up, down)


@jit
def _mark_excursions(y: FloatArray, width: int, found: BoolArray) -> None:
    """Mark excursions of `width` samples that exceed all others nearby."""
    last, half = y.size - width - 2, _NEARBY // 2
    reach = half + width + 1  # excursions that share samples are not compared
    for k in range(last + 1):
        least, _, one_side = _away(y, k, width)
        # the mean slope of the neighbouring samples
        before = y[k] - y[max(k - 1, 0)]
        after = y[min(k + width + 2, y.size - 1)] - y[k + width + 1]
        back = y[k + width + 1] - y[k] - 0.5 * (width + 1) * (before + after)
        stands_out = one_side and abs(back) < 0.3 * least
        for side in (-reach, reach):
            middle = min(max(k + side, 0), last)
            for i in range(max(middle - half, 0), min(middle + half, last) + 1):
                if not stands_out:
                    break
                stands_out = least > _STANDS_OUT * _away(y, i, width)[1]
        if stands_out:
            found[k + 1 : k + 1 + width] = True


def frozen(y: FloatArray) -> BoolArray:
    """Return which samples belong to a reading that jumps, is constant and jumps back."""
    found = np.zeros(y.size, dtype=bool)
    same = np.diff(y) == 0.0
    if same.mean() > 0.2:  # coarse sensors and records at rest are constant anyway
        return found
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    usual = _MAD * float(np.median(np.abs(np.diff(y)))) + 1e-300
    for begin, end in edges.reshape(-1, 2):
        if end - begin + 1 < _FROZEN or begin == 0 or end + 1 >= y.size:
            continue
        out, back = y[begin] - y[begin - 1], y[end + 1] - y[end]
        if min(abs(out), abs(back)) > _FAR * usual and out * back < 0.0:
            found[begin : end + 1] = True
    return found


def interpolated(displacement: FloatArray, bad: BoolArray, period: int = 0) -> FloatArray:
    """Return the displacement with `bad` samples interpolated.

    With a periodic drive by the reading at the same phase of the previous or next period, else
    linearly.

    Parameters
    ----------
    displacement : ndarray, shape (n,)
        Measured [m].
    bad : ndarray of bool, shape (n,)
        From `outliers`.
    period : int
        Samples per period of the drive; 0 where it does not repeat.
    """
    if not np.any(bad) or np.all(bad):
        return displacement
    k = np.arange(displacement.size)
    whole = displacement.copy()
    whole[bad] = np.interp(k[bad], k[~bad], displacement[~bad])
    if period:
        places = np.flatnonzero(bad)
        for there in (places - period, places + period):
            fits = (there >= 0) & (there < bad.size)
            fits[fits] = ~bad[there[fits]]
            whole[places[fits]] = displacement[there[fits]]
    return whole
