"""The plots of a page with their captions and view controls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.models import Div, RadioButtonGroup, Row, Select, Toggle

from piezo_hysteresis.dashboard.live_plots import (
    EstimatePlot,
    GapPlot,
    LoopPlot,
    PageState,
    SpectrumPlot,
    error_rms,
    new_traces,
)
from piezo_hysteresis.dashboard.live_signals import Window
from piezo_hysteresis.dashboard.live_state import Live
from piezo_hysteresis.dashboard.template import WIDGET_STYLE
from piezo_hysteresis.dashboard.texts import (
    estimate_text,
    gap_text,
    set_text,
    text_div,
    tracking_text,
)

WINDOWS = {'0.5 s': 0.5, '2 s': 2.0, '5 s': 5.0, '20 s': 20.0}
NOTHING = (float('nan'), float('nan'))


class Pictures:
    """The plots and their captions."""

    def __init__(self) -> None:
        self._time, self._traces = new_traces()
        self._loop, self._spectrum = LoopPlot(), SpectrumPlot()
        self._gap, self._estimate = GapPlot(), EstimatePlot()
        self._seconds = 2.0
        self._drawn = (-1, 0.0)
        self.tracking = NOTHING  # rms of the error and of the reference [m]
        self._stroke = math.nan  # range of the displacement [m]
        self._tracking = text_div('tracking')
        self._gap_text = text_div('gap_text')
        self._estimates = text_div('estimates')
        self._choice = Select(
            title='parameter', options=[], name='estimate_choice', sizing_mode='stretch_width'
        )
        self._choice.on_change(
            'value', lambda _, __, new: setattr(self._estimate, 'parameter', new)
        )
        self._hold = Toggle(label='Hold', name='hold')
        self.roots: list[Any] = [
            self._view(), self._loop.figure, *(trace.figure for trace in self._traces),
            self._spectrum.figure, self._tracking, self._gap.figure, self._gap_text, self._choice,
            self._estimate.figure, self._estimates,
        ]  # fmt: skip

    def _view(self) -> Row:
        window = RadioButtonGroup(labels=list(WINDOWS), active=1, name='window')
        window.on_change('active', lambda _, __, new: self._show_seconds(new))
        across = RadioButtonGroup(
            labels=['over voltage', 'over reference'], active=0, name='input'
        )
        across.on_change(
            'active',
            lambda _, __, new: setattr(self._loop, 'input', ('voltage', 'reference')[new]),
        )
        of = RadioButtonGroup(labels=['of displacement', 'of error'], active=0, name='signal')
        of.on_change(
            'active',
            lambda _, __, new: setattr(self._spectrum, 'signal', ('displacement', 'error')[new]),
        )
        for group in (window, across, of):
            group.update(margin=(2, 4, 2, 0))

        def labelled(text: str, *widgets: Any) -> Row:
            label = Div(text=text, stylesheets=[WIDGET_STYLE], margin=(8, 4, 0, 8))
            return Row(label, *widgets)

        return Row(
            labelled('Last', window), labelled('Loop', across),
            labelled('Spectrum', of, self._hold),
            name='view', sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'},
        )  # fmt: skip

    def _show_seconds(self, chosen: int) -> None:
        self._seconds = list(WINDOWS.values())[chosen]
        start = -self._seconds
        self._time.update(start=start, end=0.0, reset_start=start, reset_end=0.0)

    def refresh(self, live: Live, slowly: bool) -> None:
        """Draw the current state."""
        if slowly:
            self._slow_text(live)
        newest = live.signals.newest
        if self._hold.active or newest < 0:
            return
        if newest != self._drawn[0] or self._seconds != self._drawn[1]:
            self._drawn = (newest, self._seconds)
            window = live.signals.window(max(self._seconds, 4.0))
            scene = PageState(window, self._seconds, live.fundamental, live.resonance)
            self._loop.show(scene)
            for trace in self._traces:
                trace.show(scene)
            if slowly:
                self._spectrum.show(scene)
                self._show_tracking(window, scene.fundamental)

    def _show_tracking(self, window: Window, fundamental: float) -> None:
        moved = window.displacement[np.isfinite(window.displacement)]
        self._stroke = float(np.ptp(moved)) if moved.size else math.nan
        self.tracking = error_rms(window, fundamental) if window.tracked else NOTHING
        set_text(self._tracking, tracking_text(*self.tracking))

    def _slow_text(self, live: Live) -> None:
        gaps, estimates = list(live.gaps), list(live.estimates)
        parameters = live.parameters
        monitored, error = 'gap_monitor' in parameters, self.tracking[0]
        set_text(self._gap_text, gap_text(gaps, monitored, live.actuator, self._stroke, error))
        known = 'identification' in parameters
        set_text(self._estimates, estimate_text(estimates, known, live.actuator))
        if not self._hold.active:
            self._gap.show(gaps, live.clock())
            self._estimate.show(estimates, live.clock())
        names = list(estimates[-1].names) if estimates else []
        if names != list(self._choice.options):
            self._choice.options = names
            if self._choice.value not in names:
                self._choice.value = names[0] if names else ''
