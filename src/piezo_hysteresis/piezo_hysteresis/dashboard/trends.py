"""Trends: the gap in multiples of the noise floor, and the estimates with their bands."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from bokeh.models import ColumnDataSource, Label, Range1d, Span

from piezo_hysteresis.dashboard.axes import Follower, live_axes
from piezo_hysteresis.dashboard.live_state import Gap, ShownEstimate
from piezo_hysteresis.reporting.display_units import shown
from piezo_hysteresis.reporting.plot_parts import GREY, PALETTE

SECONDS = 120.0
BAND = 2.0  # standard deviations


class GapPlot:
    """The gap in multiples of the noise floor over the last minutes."""

    def __init__(self) -> None:
        self._y = Follower(logarithmic=True, floor=0.1)
        self.figure = live_axes(
            'Gap between model and measurement', 'seconds before now', 'noise floors',
            Range1d(-SECONDS, 1.0), self._y.range, y_axis_type='log',
        )  # fmt: skip
        self.figure.name = 'gap'
        self.figure.yaxis.ticker.mantissas = [1]  # only powers of ten; others would overlap
        self._source = ColumnDataSource(
            {'x': [], 'y': [], 'colour': [], 'marker': []}, name='gap.floors'
        )
        self.figure.line('x', 'y', source=self._source, color=GREY)
        self.figure.scatter('x', 'y', source=self._source, color='colour', marker='marker', size=6)
        line = {'line_dash': 'dotted', 'line_color': '#000000', 'line_width': 1.5}
        self.figure.add_layout(Span(location=1.0, dimension='width', **line))
        self.figure.add_layout(
            Label(x=6, x_units='screen', y=1.0, text='noise floor', text_font_size='11px',
                  y_offset=2)
        )  # fmt: skip

    def show(self, gaps: Sequence[Gap], now: float) -> None:
        """Draw the received values."""
        recent = [gap for gap in gaps if now - gap.at < SECONDS]
        self._source.data = {
            'x': [gap.at - now for gap in recent],
            'y': [max(gap.floors, 1e-3) for gap in recent],
            'colour': [PALETTE[1 if gap.beyond else 0] for gap in recent],
            'marker': ['square' if gap.beyond else 'circle' for gap in recent],
        }
        sizes = [1.0, *(gap.floors for gap in recent if math.isfinite(gap.floors))]
        self._y.fit(min(0.5, *sizes), max(3.0, *sizes))


class EstimatePlot:
    """One estimated parameter with its band over the last minutes."""

    def __init__(self) -> None:
        self.parameter = ''
        self._y = Follower(floor=1e-9)
        self.figure = live_axes(
            'Parameter estimate', 'seconds before now', 'value', Range1d(-SECONDS, 1.0),
            self._y.range,
        )  # fmt: skip
        self.figure.name = 'estimate'
        self._source = ColumnDataSource(
            {'x': [], 'y': [], 'low': [], 'high': []}, name='estimate.values'
        )
        self.figure.varea(
            'x', 'low', 'high', source=self._source, fill_color=PALETTE[0], fill_alpha=0.2
        )
        self.figure.line('x', 'y', source=self._source, color=PALETTE[0], line_width=1.8)

    def show(self, estimates: Sequence[ShownEstimate], now: float) -> None:
        """Draw the received values of the selected parameter."""
        name = self.parameter
        recent = [e for e in estimates if now - e.at < SECONDS and name in e.names]
        if not recent:
            self._source.data = {'x': [], 'y': [], 'low': [], 'high': []}
            return
        unit, factor = shown(recent[-1].units[recent[-1].names.index(name)])
        places = [e.names.index(name) for e in recent]
        value = factor * np.array([e.values[k] for e, k in zip(recent, places, strict=True)])
        spread = BAND * abs(factor) * np.nan_to_num(
            [e.deviations[k] for e, k in zip(recent, places, strict=True)], posinf=0.0
        )  # fmt: skip
        self._source.data = {
            'x': [e.at - now for e in recent],
            'y': value,
            'low': value - spread,
            'high': value + spread,
        }
        self.figure.yaxis.axis_label = f'{name} [{unit}]' if unit else name
        tail = slice(-max(3, len(recent) // 2), None)  # the range excludes the initial transient
        low, high = float(np.min((value - spread)[tail])), float(np.max((value + spread)[tail]))
        self._y.fit(low, max(high, low + 1e-3 * abs(low)))
