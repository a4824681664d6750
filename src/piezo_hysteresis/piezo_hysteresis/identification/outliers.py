"""Detection of outliers: spikes, drop-outs, readings out of range, and steps of a counter.

A sample is excluded only with two witnesses. The first is here: it is unlike its neighbours, and
the voltage does not move there as well. The second is the fitted model: the revision takes back
every sample that the model with a free initial state explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.jit import inline_jit, jit

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
_SUDDEN = 0.5  # share of its height by which an outlier begins and ends within two samples
_DRIVEN = 3.0  # times the mean gain: largest motion that a motion of the voltage explains
_LAG = 3  # samples by which the displacement may follow the voltage
# Readings out of range: largest share of the samples, and the ratio of the range of a record to
# that of its middle from which they are looked for.
_MOST_OUT = 0.4
_FAR_OUT = 8.0
_CODE = 20.0  # times the range of all others: distance of a code from them
# Steps of a counter: samples of the lines on either side, the share of a step within one sample,
# samples by which it may follow a jump of the voltage, and the largest number in a record.
_SIDE = 8
_AT_ONCE = 0.7
_AFTER_DRIVE = 20
_MOST_STEPS = 20
# Samples and blocks from which the usual size of the differences of a long record is taken.
_SAMPLE, _BLOCKS = 250_000, 500


def outliers(
    voltage: FloatArray,  # [V] (n,)
    displacement: FloatArray,  # [m] (n,)
    period: int,
    first: int = 0,
    alone: BoolArray | None = None,  # (n,)
) -> BoolArray:
    """Return which samples are spikes, drop-outs or out of range, shape (n,).

    Periods are compared with their median, phase by phase; all records are checked for excursions
    of a few samples that return to their origin, and for a reading that jumps, is constant and
    jumps back. An excursion that the voltage makes as well is motion, and what begins or ends
    gradually is no outlier: a virgin curve, settling, a turning point of a coarse table.
    """
    if alone is not None and not period:
        return alone
    out = out_of_range(voltage, displacement)
    y = interpolated(displacement, out)
    if alone is None:
        found = excursions(y)
        found &= ~_follows(voltage, y, found)
        found |= out | frozen(y)
    else:
        found = alone.copy()
    count = (y.size - first) // period if period else 0
    if count >= _FEWEST_PERIODS:
        begin = y.size - count * period
        left, usual = _differences(y[begin:].reshape(count, period))
        found[begin:] |= _unlike(left, usual) & ~_transient(left[:period], usual, left.size)
    return found


def out_of_range(voltage: FloatArray, displacement: FloatArray) -> BoolArray:
    """Return which readings lie farther from all others than these spread, shape (n,).

    Sensors report a code such as -9999 where they see no target. A stage that rests and is pulsed
    has such readings too, but its voltage lies then apart as well.
    """
    y, found = displacement, np.zeros(displacement.size, dtype=bool)
    few = int(_MOST_OUT * y.size)
    if few < 1 or y.size < 2 * _NEARBY:
        return found
    parts = np.partition(y, (few, y.size - 1 - few))
    middle = float(parts[y.size - 1 - few] - parts[few])
    if float(np.ptp(y)) <= _FAR_OUT * middle:
        return found
    order = np.sort(y)
    gaps = np.diff(order)
    low = int(np.argmax(gaps[:few]))
    high = gaps.size - few + int(np.argmax(gaps[-few:]))
    spread = float(order[high] - order[low + 1])
    if not 0.0 < spread < max(gaps[low], gaps[high]):
        return found
    for beyond, gap in ((y <= order[low], gaps[low]), (y > order[high], gaps[high])):
        if gap > spread and not _pulsed(voltage, y, beyond, _CODE * spread < gap):
            found |= beyond
    return found


def _pulsed(u: FloatArray, y: FloatArray, beyond: BoolArray, far: bool) -> bool:
    """Return whether the voltage explains that readings lie apart: it was pulsed then.

    Most runs of such readings begin or end with a voltage outside that of the other readings, or
    with the record: a stage that has not moved yet.
    """
    reached = np.percentile(u[~beyond], (1.0, 99.0))
    covered = float(np.ptp(reached)) > 0.5 * float(np.ptp(u))
    if far and covered and np.count_nonzero(beyond) > 1 and float(np.ptp(y[beyond])) == 0.0:
        return False  # one value far away, at voltages next to the others: a code
    outside = (u < reached[0]) | (u > reached[1])
    runs = runs_of(beyond)
    explained = [
        begin == 0 or end == y.size or bool(np.any(outside[max(begin - _LAG, 0) : end]))
        for begin, end in runs
    ]
    return sum(explained) > 0.5 * len(runs)


def _follows(u: FloatArray, y: FloatArray, found: BoolArray) -> BoolArray:
    """Return which excursions the voltage makes as well, up to three samples earlier."""
    follows = np.zeros(y.size, dtype=bool)
    reach = float(np.ptp(u))
    if reach == 0.0:
        return follows
    gain = _DRIVEN * float(np.ptp(y)) / reach
    for begin, end in runs_of(found):
        before, after = max(begin - 1, 0), min(end, y.size - 1)

        def away(x: FloatArray, shift: int, ends: tuple[int, int] = (before, after)) -> float:
            a, b = max(ends[0] - shift, 0), max(ends[1] - shift, 1)
            line = np.linspace(x[a], x[b], b - a + 1)
            return float(np.max(np.abs(x[a : b + 1] - line)))

        moved = max(away(u, shift) for shift in range(_LAG + 1))
        follows[begin:end] = away(y, 0) <= gain * moved
    return follows


def runs_of(marked: BoolArray) -> list[tuple[int, int]]:
    """Return first sample and the one after the last of every run of marked samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.view(np.int8), [0]])))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _differences(periods: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the differences of periods from their median, and the usual ones, (count, period)."""
    left = periods - np.median(periods, axis=0)
    left -= np.median(left, axis=1, keepdims=True)  # a drift from period to period is no outlier
    typical = np.median(np.abs(left), axis=1, keepdims=True)
    # if most samples of a coarse sensor repeat exactly, its steps are the usual deviation
    usual = max(float(np.median(typical)), _SMALLEST * float(np.ptp(periods)))
    usual = max(usual, 0.5 * step_of(periods.ravel(), negligible=2.0 * usual))
    # a period within the transient differs everywhere from the others: these are no outliers
    allowed = np.where(typical < _SETTLING * usual, _FAR * _MAD * usual, np.inf)
    return left.ravel(), np.broadcast_to(allowed, periods.shape).ravel()


def _unlike(left: FloatArray, allowed: FloatArray) -> BoolArray:
    """Return which differences begin or end suddenly and are larger than allowed, shape (n,)."""
    found = np.abs(left) > allowed
    for begin, end in runs_of(found):
        height = _SUDDEN * float(np.median(np.abs(left[begin:end])))
        short = end - begin <= _WIDEST
        sides = []
        for inside, outside in ((begin + 1, begin - 2), (end - 2, end + 1)):
            inside = min(max(inside, begin), end - 1)
            at_edge = begin == 0 if outside < begin else end == left.size
            outside = min(max(outside, 0), left.size - 1)
            sides.append(short if at_edge else abs(left[inside] - left[outside]) > height)
        found[begin:end] = any(sides)
    return found


def _transient(first: FloatArray, allowed: FloatArray, samples: int) -> BoolArray:
    """Return which of all `samples` belong to a transient of the first period, shape (samples,).

    It is there from the first sample on, and whatever follows it is smaller: it decays or rings.
    The record may begin anywhere in a swing, so that the next one is whole and higher.
    """
    found, size = np.zeros(samples, dtype=bool), np.abs(first)
    largest, last, swings = 0.0, 0, 0
    for begin, end in runs_of(size > allowed[: size.size]):
        height = float(np.max(size[begin:end]))
        next_swing = swings < 2 and begin - last <= max(end - begin, _WIDEST)
        if begin < _WIDEST or height <= largest or next_swing:
            found[begin:end] = True
            largest, last, swings = max(largest, height), end, swings + 1
    return found


@dataclass(frozen=True)
class CounterStep:
    """A jump of the reading that stays: a counter lost a fringe, or was set to zero."""

    sample: int  # first sample after the jump
    height: float  # change of the reading [m]


def counter_steps(
    voltage: FloatArray, displacement: FloatArray, period: int = 0
) -> list[CounterStep]:  # voltage [V] (n,); displacement [m] (n,)
    """Return the jumps that stay and that no jump of the voltage explains, in order.

    On either side of every sample a line is fitted to eight samples. Where the lines miss each
    other by much more than usual, and the reading does so within one sample, it jumped.
    """
    y, reach = displacement, float(np.ptp(voltage))
    if y.size < 8 * _SIDE or float(np.ptp(y)) == 0.0:
        return []
    gap = _gaps(y)
    coarse = float(np.mean(np.diff(y) == 0.0))
    least = max(_FAR * _MAD * _usual_size(gap), 1e-4 * float(np.ptp(y)))
    if float(np.max(np.abs(gap))) > least:
        least = max(least, 3.0 * step_of(y))
    places = np.flatnonzero(np.abs(gap) > least)
    if not places.size:
        return []
    gain = float(np.ptp(y)) / reach if reach > 0.0 else 0.0
    driven = np.abs(_gaps(voltage)) * gain
    steps: list[CounterStep] = []
    for group in np.split(places, np.flatnonzero(np.diff(places) > _SIDE) + 1):
        k = int(group[np.argmax(np.abs(gap[group]))])  # the jump is between k - 1 and k
        height = float(gap[k])
        around = np.r_[y[k - 5 : k], y[k : k + 5]]
        slope = float(np.median(np.diff(around)))
        at_once = abs(y[k] - y[k - 1] - slope) > _AT_ONCE * abs(height)
        drive = float(np.max(driven[max(k - _AFTER_DRIVE, 0) : k + 2]))
        still = np.diff(y[k - _SIDE : k]), np.diff(y[k : k + _SIDE])
        if coarse < 0.2 and any(np.count_nonzero(x == 0.0) >= _FROZEN - 1 for x in still):
            continue  # a drop-out
        if at_once and drive < 0.5 * abs(height) and _lasts(y, k, height, period):
            steps.append(CounterStep(k, height))
    return steps if len(steps) <= _MOST_STEPS else []


def _lasts(y: FloatArray, k: int, height: float, period: int) -> bool:
    """Return whether periods before and after a jump differ by about its height."""
    if not period or k < period or k + period > y.size:
        return True
    change = float(np.median(y[k : k + period] - y[k - period : k]))
    return abs(change - height) < 0.5 * abs(height)


def _usual_size(x: FloatArray) -> float:
    """Return the median size of values; of a long record by blocks all over it."""
    if x.size > 4 * _SAMPLE:
        x = x[: x.size // _BLOCKS * _BLOCKS].reshape(_BLOCKS, -1)[:, : _SAMPLE // _BLOCKS]
    return float(np.median(np.abs(x)))


def _gaps(x: FloatArray) -> FloatArray:
    """Return by how much lines through the samples before and after each sample miss, (n,)."""
    place = np.arange(_SIDE) - 0.5 * (_SIDE - 1)
    # value of the line half a sample beyond its end, as weights of its samples
    ahead = 1.0 / _SIDE + 0.5 * _SIDE * place / float(place @ place)
    weights = np.concatenate([-ahead, ahead[::-1]])
    found = np.zeros(x.size)
    found[_SIDE : x.size - _SIDE + 1] = np.correlate(x, weights, mode='valid')
    return found


def without_steps(displacement: FloatArray, steps: Sequence[CounterStep]) -> FloatArray:
    """Return the displacement [m] with every step taken out of the samples after it."""
    whole = displacement.copy()
    for step in steps:
        whole[step.sample :] -= step.height
    return whole


def step_of(
    y: FloatArray, *, same: float = _SAME, fewest: int = 2, negligible: float = 0.0
) -> float:  # y [m] (n,); negligible [m]
    """Return the smallest difference between two readings [m]: the step of a coarse sensor."""
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


@inline_jit
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
    usual = _MAD * _usual_size(np.diff(y)) + 1e-300
    for begin, end in runs_of(same):
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
    """
    # displacement [m] (n,); bad (n,)
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
