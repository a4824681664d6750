"""Difference between the way up and the way down of a scan, as measured, without a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record

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
