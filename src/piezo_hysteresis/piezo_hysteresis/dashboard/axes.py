"""Axis ranges that follow the data with hysteresis and keep a zoom of the user."""

from __future__ import annotations

import math
from typing import Any

from bokeh.core.property.descriptors import UnsetValueError
from bokeh.models import Range1d

from piezo_hysteresis.reporting.plot_parts import new_axes

HEIGHT = 230


class Follower:
    """Range around the data: it grows immediately and shrinks only if much of it is empty."""

    def __init__(self, logarithmic: bool = False, floor: float = 1e-3) -> None:
        start, end = (0.1, 10.0) if logarithmic else (-1.0, 1.0)
        self.range = Range1d(start, end)
        self._logarithmic, self._floor = logarithmic, floor
        self._set = (start, end)

    def fit(self, low: float, high: float) -> None:
        """Extend the range to `low` .. `high`."""
        if not (math.isfinite(low) and math.isfinite(high)):
            return
        if (self.range.start, self.range.end) != self._set:
            return  # the user has zoomed; the reset tool restores the automatic range
        limits = self._decades(low, high) if self._logarithmic else self._linear(low, high)
        if limits != self._set:
            self._set = limits
            start, end = limits
            self.range.update(start=start, end=end, reset_start=start, reset_end=end)

    def _decades(self, low: float, high: float) -> tuple[float, float]:
        bottom = math.floor(math.log10(max(low, self._floor)))
        top = math.ceil(math.log10(max(high, self._floor) * 1.2))
        return 10.0**bottom, 10.0 ** max(top, bottom + 1)

    def _linear(self, low: float, high: float) -> tuple[float, float]:
        span = max(high - low, self._floor)
        start, end = self._set
        inside = start <= low - 0.01 * span and high + 0.01 * span <= end
        if inside and span > 0.6 * (end - start):
            return self._set
        middle = 0.5 * (low + high)
        return middle - 0.6 * span, middle + 0.6 * span


def live_axes(title: str, x_label: str, y_label: str, x: Any, y: Any, **options: Any) -> Any:
    """Return an empty plot in the style of the reports, with less height and inactive tools."""
    plot = new_axes(title, x_label, y_label, x_range=x, y_range=y, **options)
    plot.frame_height = HEIGHT
    plot.toolbar.active_drag = None  # a finger on a plot scrolls the page
    plot.toolbar.autohide = True
    plot.toolbar.stylesheets = [':host(.bk-hidden) { visibility: hidden; }']
    return plot


def columns_of(plot: Any) -> int:
    """Return the number of pixel columns of the plot in the browser."""
    try:
        width = int(plot.inner_width)
    except UnsetValueError:  # not on a screen yet
        width = 0
    return min(max(width, 300), 1600)
