"""One reader's page: plots, controls and words, kept up to date from what is known."""

from __future__ import annotations

import time
from datetime import datetime
from functools import partial
from typing import Any

from bokeh.document import Document
from bokeh.models import (
    Column,
    CustomJS,
    Div,
    RadioButtonGroup,
    Row,
    Select,
    Toggle,
)

from piezo_hysteresis.dashboard.backend import Answer, Backend
from piezo_hysteresis.dashboard.controls import (
    EFFECTS,
    Value,
    drive_parameters,
    effect_parameters,
    groups_of,
)
from piezo_hysteresis.dashboard.forms import DiscoveryForm, SweepForm
from piezo_hysteresis.dashboard.plots import (
    LoopPlot,
    Scene,
    SpectrumPlot,
    error_rms,
    new_traces,
)
from piezo_hysteresis.dashboard.rows import RowList
from piezo_hysteresis.dashboard.template import WIDGET_STYLE, page_template
from piezo_hysteresis.dashboard.trends import EstimatePlot, GapPlot
from piezo_hysteresis.dashboard.words import (
    banner,
    estimate_words,
    gap_words,
    pulse,
    status_words,
    tracking_words,
)

WINDOWS = {'0.5 s': 0.5, '2 s': 2.0, '5 s': 5.0, '20 s': 20.0}
SLOWLY = 0.3  # words and spectra change no faster [s]
NONE = '(general)'


def words_div(name: str) -> Div:
    """Return an empty place for words."""
    return Div(text='', name=name, stylesheets=[WIDGET_STYLE], sizing_mode='stretch_width')


class Pictures:
    """The plots and what is said beside them."""

    def __init__(self) -> None:
        self._time, self._traces = new_traces()
        self._loop, self._spectrum = LoopPlot(), SpectrumPlot()
        self._gap, self._estimate = GapPlot(), EstimatePlot()
        self._seconds = 2.0
        self._drawn = (-1, 0.0)
        self._tracking = words_div('tracking')
        self._gap_words = words_div('gap_words')
        self._estimates = words_div('estimates')
        self._choice = Select(
            title='parameter', options=[], name='estimate_choice', sizing_mode='stretch_width'
        )
        self._choice.on_change(
            'value', lambda _, __, new: setattr(self._estimate, 'parameter', new)
        )
        self._hold = Toggle(label='Hold', name='hold')
        self.roots: list[Any] = [
            self._view(), self._loop.figure, *(trace.figure for trace in self._traces),
            self._spectrum.figure, self._tracking, self._gap.figure, self._gap_words, self._choice,
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

    def refresh(self, live: Any, slowly: bool) -> None:
        """Draw what is known now."""
        if slowly:
            self._slow_words(live)
        newest = live.signals.newest
        if self._hold.active or newest < 0:
            return
        if newest != self._drawn[0] or self._seconds != self._drawn[1]:
            self._drawn = (newest, self._seconds)
            window = live.signals.window(max(self._seconds, 4.0))
            scene = Scene(window, self._seconds, live.fundamental, live.resonance)
            self._loop.show(scene)
            for trace in self._traces:
                trace.show(scene)
            if slowly:
                self._spectrum.show(scene)
                rms = (
                    error_rms(window, scene.fundamental) if window.tracked else (float('nan'),) * 2
                )
                say(self._tracking, tracking_words(*rms))

    def _slow_words(self, live: Any) -> None:
        gaps, estimates = list(live.gaps), list(live.estimates)
        parameters = live.parameters
        say(self._gap_words, gap_words(gaps, 'gap_monitor' in parameters))
        say(self._estimates, estimate_words(estimates, 'identification' in parameters))
        if not self._hold.active:
            self._gap.show(gaps, live.clock())
            self._estimate.show(estimates, live.clock())
        names = list(estimates[-1].names) if estimates else []
        if names != list(self._choice.options):
            self._choice.options = names
            if self._choice.value not in names:
                self._choice.value = names[0] if names else ''


class Controls:
    """Sliders, switches, forms and the state of the nodes."""

    def __init__(self, backend: Backend, actuator: str) -> None:
        self._live = backend.live(actuator)
        send = partial(_send, backend, actuator)
        find = self._live.parameter
        self._drive = RowList(send, find, 'drive', 'No excitation or controller is running.')
        self._effects = RowList(send, find, 'effects', 'No simulator is running here.', brief=True)
        self._all = RowList(send, find, 'all_rows', 'No parameters yet.', prefix='all.')
        self._node = Select(title='node', options=[], name='all.node')
        self._group = Select(title='group', options=[], name='all.group')
        self._sweep = SweepForm(
            partial(backend.start_sweep, actuator), partial(backend.cancel_sweep, actuator),
            _new_name,
        )  # fmt: skip
        self._discovery = DiscoveryForm(
            partial(backend.start_discovery, actuator),
            partial(backend.cancel_discovery, actuator),
            partial(backend.bags, actuator),
        )
        self._status = words_div('status')
        choice = Row(self._node, self._group, sizing_mode='stretch_width')
        self.roots: list[Any] = [
            self._drive.root, self._effects.root, self._sweep.root, self._discovery.root,
            Column(choice, self._all.root, name='all', sizing_mode='stretch_width'), self._status,
        ]  # fmt: skip

    def refresh(self, slowly: bool) -> None:
        """Follow the nodes."""
        live = self._live
        parameters = live.parameters
        self._drive.refresh(drive_parameters(parameters), parameters)
        self._effects.refresh(effect_parameters(parameters), parameters)
        self._choose(parameters)
        self._sweep.refresh(live.sweep, live.sweeps_offered)
        self._discovery.refresh(live.discovery, live.discoveries_offered)
        if slowly:
            say(self._status, status_words(live))
            self._discovery.look()

    def _choose(self, parameters: Any) -> None:
        nodes = sorted(parameters)
        _offer(self._node, nodes)
        own = parameters.get(self._node.value, {})
        groups = groups_of(p for p in own.values() if p.group != EFFECTS)
        _offer(self._group, [group or NONE for group in groups])
        chosen = self._group.value
        self._all.refresh(groups.get('' if chosen == NONE else chosen, []), parameters)


def _offer(select: Select, words: list[str]) -> None:
    if words != list(select.options):
        select.options = words
    if select.value not in words:
        select.value = words[0] if words else ''


def _send(backend: Backend, actuator: str, node: str, name: str, value: Value) -> Answer:
    return backend.set_parameters(actuator, node, {name: value})


def _new_name() -> str:
    return datetime.now().strftime('sweep_%Y-%m-%d_%H-%M-%S')


def say(place: Div, text: str) -> None:
    """Change words only where they are others."""
    if place.text != text:
        place.text = text


class Page:
    """The document of one reader.

    Parameters
    ----------
    document : Document
        Empty so far.
    backend : Backend
        Speaks to the nodes.
    actuator : str
        Namespace of the actuator.
    chosen : bool
        Whether the reader asked for this one; otherwise the page goes over to one that is found.
    refresh : float
        How often it is drawn [Hz].
    """

    def __init__(
        self,
        document: Document,
        backend: Backend,
        actuator: str,
        chosen: bool = False,
        refresh: float = 10.0,
    ) -> None:
        self._backend, self._chosen = backend, chosen
        self._live = backend.live(actuator)
        self._pictures = Pictures()
        self._controls = Controls(backend, actuator)
        self._banner = words_div('banner')
        self._pulse = Div(text='', name='pulse', stylesheets=[WIDGET_STYLE])
        self._actuator = Select(
            value=actuator or '/', options=[actuator or '/'], name='actuator', width=180
        )
        self._actuator.js_on_change(
            'value',
            CustomJS(code="location.search = '?actuator=' + encodeURIComponent(cb_obj.value)"),
        )
        self._slow = 0.0
        document.title = f'Actuator {actuator}'.strip()
        document.template = page_template()
        with document.models.freeze():  # or every root would have all models counted anew
            for root in (
                self._actuator, self._pulse, self._banner, *self._pictures.roots,
                *self._controls.roots,
            ):  # fmt: skip
                document.add_root(root)
            self.refresh()
        document.add_periodic_callback(self.refresh, round(1000 / refresh))

    def refresh(self) -> None:
        """Bring everything up to date."""
        now = time.monotonic()
        slowly = now - self._slow >= SLOWLY
        if slowly:
            self._slow = now
            self._offer_actuators()
            say(self._banner, banner(self._live))
            say(self._pulse, pulse(self._live))
        self._controls.refresh(slowly)
        self._pictures.refresh(self._live, slowly)

    def _offer_actuators(self) -> None:
        found = self._backend.actuators()
        options = sorted({name or '/' for name in (*found, self._live.actuator)})
        if options != list(self._actuator.options):
            self._actuator.options = options
        self._actuator.visible = len(options) > 1
        if not self._chosen and not self._live.heard and self._live.actuator not in found:
            self._actuator.value = found[0] or '/'
