"""The plots of a page with their captions and view controls."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.models import CustomJS, Div, RadioButtonGroup, Row, Select, Toggle

from piezo_hysteresis.dashboard.backend import Backend
from piezo_hysteresis.dashboard.live_plots import (
    EstimatePlot,
    GapPlot,
    LoopPlot,
    PageState,
    SpectrumPlot,
    error_rms,
    new_traces,
)
from piezo_hysteresis.dashboard.live_state import Live, Window
from piezo_hysteresis.dashboard.panel import Controls
from piezo_hysteresis.dashboard.texts import (
    WIDGET_STYLE,
    banner,
    estimate_text,
    gap_text,
    page_template,
    pulse,
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


SLOWLY = 0.3  # shortest interval of updates of texts and spectra [s]
TIMEOUT = 10.0  # time after which an update is treated as lost [s]

# Runs in the browser after an update is drawn; in a hidden tab it waits.
SEEN = (
    'const tags = cb_obj.tags; requestAnimationFrame(() => setTimeout(() => {seen.tags = tags}))'
)


class Flow:
    """Flow control: the next update is sent only after the browser has drawn the previous one.

    Otherwise a slow browser would accumulate a delay.
    """

    def __init__(self, beat: Div) -> None:
        self._beat = beat
        self._number = 0
        self._sent_at = 0.0
        self.seen = Div(name='seen')
        beat.js_on_change('tags', CustomJS(args={'seen': self.seen}, code=SEEN))

    def ready(self) -> bool:
        """Return whether the browser waits for an update."""
        late = time.monotonic() - self._sent_at > TIMEOUT
        return late or list(self.seen.tags) == list(self._beat.tags)

    def sent(self) -> None:
        """Note that an update is sent."""
        self._number += 1
        self._sent_at = time.monotonic()
        self._beat.tags = [self._number]


class Page:
    """The document of one client."""

    def __init__(
        self,
        document: Document,
        backend: Backend,
        actuator: str,
        chosen: bool = False,
        refresh: float = 10.0,  # [Hz]
    ) -> None:
        self._backend, self._chosen = backend, chosen
        self._live = backend.live(actuator)
        self._pictures = Pictures()
        self._controls = Controls(backend, actuator)
        self._banner = text_div('banner')
        self._pulse = Div(text='', name='pulse', stylesheets=[WIDGET_STYLE])
        self._actuator = Select(
            value=actuator or '/', options=[actuator or '/'], name='actuator', width=180
        )
        self._actuator.js_on_change(
            'value',
            CustomJS(code="location.search = '?actuator=' + encodeURIComponent(cb_obj.value)"),
        )
        self._flow = Flow(self._pulse)
        self._slow = 0.0
        document.title = f'Actuator {actuator}'.strip()
        document.template = page_template()
        with document.models.freeze():  # otherwise each root would count all models again
            for root in (
                self._actuator, self._pulse, self._banner, *self._pictures.roots,
                *self._controls.roots,
            ):  # fmt: skip
                document.add_root(root)
            self._controls.refresh()
            self._draw(self._is_slow())
        document.add_periodic_callback(self.refresh, round(1000 / refresh))

    def refresh(self) -> None:
        """Update all parts of the page."""
        self._controls.refresh()
        if self._flow.ready():
            self._draw(self._is_slow())
            self._flow.sent()

    def _is_slow(self) -> bool:
        now = time.monotonic()
        if now - self._slow < SLOWLY:
            return False
        self._slow = now
        return True

    def _draw(self, slowly: bool) -> None:
        if slowly:
            self._offer_actuators()
            set_text(self._banner, banner(self._live))
            set_text(self._pulse, pulse(self._live, self._pictures.tracking))
            self._controls.show_state()
        self._pictures.refresh(self._live, slowly)

    def _offer_actuators(self) -> None:
        found = self._backend.actuators()
        options = sorted({name or '/' for name in (*found, self._live.actuator)})
        if options != list(self._actuator.options):
            self._actuator.options = options
        self._actuator.visible = len(options) > 1
        if not self._chosen and not self._live.received and self._live.actuator not in found:
            self._actuator.value = found[0] or '/'
