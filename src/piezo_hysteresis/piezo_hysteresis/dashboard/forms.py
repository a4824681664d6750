"""Forms to start a sweep and a discovery, with progress, cancel and result."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from bokeh.models import (
    Button,
    Column,
    ColumnDataSource,
    Div,
    Legend,
    LegendItem,
    MultiSelect,
    NumericInput,
    Progress,
    Range1d,
    Row,
    Select,
    TextInput,
)

from piezo_hysteresis.common.parameter_table import range_refusal
from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder, SweepOrder
from piezo_hysteresis.dashboard.live_plots import live_axes
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState
from piezo_hysteresis.dashboard.texts import (
    WIDGET_STYLE,
    job_text,
    set_text,
    start_text,
    text_div,
    time_text,
)
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import NAMES
from piezo_hysteresis.reporting.plots import PALETTE

_NAME = re.compile(r'^[A-Za-z0-9][A-Za-z0-9_.-]{0,79}$')


def numbers(text: str, what: str) -> tuple[float, ...]:
    """Return the numbers of a typed list."""
    items = [item for item in re.split(r'[\s,;]+', text) if item]
    if not items:
        raise PiezoError(f'{what}: type at least one number, such as 1, 5, 10')
    try:
        return tuple(float(item) for item in items)
    except ValueError:
        raise PiezoError(f'{what}: {text!r} is no list of numbers, such as 1, 5, 10') from None


class JobBox:
    """Progress, cancel button and message of one job."""

    def __init__(self, name: str, start: Callable[[], None], cancel: Callable[[], None]) -> None:
        self._start = start
        self._shown: tuple[BackgroundJob, bool, str] | None = None
        self.start = Button(label=f'Start {name}', button_type='primary', name=f'{name}.start')
        self.cancel = Button(label='Cancel', disabled=True, name=f'{name}.cancel')
        self.bar = Progress(
            value=0, max=100, name=f'{name}.bar', sizing_mode='stretch_width', visible=False
        )
        self.words = Div(
            text='',
            visible=False,
            name=f'{name}.words',
            stylesheets=[WIDGET_STYLE],
            sizing_mode='stretch_width',
        )
        self.start.on_click(self._press)
        self.cancel.on_click(cancel)
        self.parts = [Row(self.start, self.cancel), self.bar, self.words]

    def _press(self) -> None:
        try:
            self._start()
        except PiezoError as error:
            self._show(f'<p class="error">{escape(str(error))}</p>')

    def refresh(self, job: BackgroundJob, offered: bool, hint: str, now: float) -> None:
        """Show the state at `now`; `hint` (HTML) if no node provides the job."""
        spent = time_text(job, now)
        if self._shown == (job, offered, spent):
            return
        self._shown = (job, offered, spent)
        self.start.disabled = job.busy or not offered
        self.cancel.disabled = not job.busy
        self.bar.visible = job.busy
        self.bar.value = round(100 * job.fraction)
        text = job_text(job) + (f'<p class="soft">{spent}</p>' if spent else '')
        self._show(text or ('' if offered else hint))

    def _show(self, text: str) -> None:
        self.words.update(text=text, visible=bool(text))


class SweepForm:
    """Frequencies and amplitudes of a sweep, and the bag of its records."""

    def __init__(
        self,
        start: Callable[[SweepOrder], None],
        cancel: Callable[[], None],
        next_name: Callable[[], str],
        actuator: str = '',
    ) -> None:
        self._hint = start_text('No excitation offers sweeps.', 'excitation', actuator)
        self._order = start
        self._next_name = next_name
        wide = {'sizing_mode': 'stretch_width'}
        self._frequencies = TextInput(
            title='frequencies [Hz]', value='1, 5, 10, 15, 20, 23, 40', name='sweep.frequencies',
            **wide,
        )  # fmt: skip
        self._amplitudes = TextInput(
            title='amplitudes [V]', value='1.0, 0.5', name='sweep.amplitudes', **wide
        )
        self._seconds = self._number('record length [s]', 3.0, 'sweep.seconds')
        self._warm_up = self._number('warm-up [s]', 1.0, 'sweep.warm_up')
        self._pause = self._number('pause [s]', 0.0, 'sweep.pause')
        self._name = TextInput(
            title='name of the bag', value=next_name(), name='sweep.name', **wide
        )
        self.box = JobBox('sweep', self._start, cancel)
        self.root = Column(
            self._frequencies,
            self._amplitudes,
            Row(self._seconds, self._warm_up, self._pause, **wide),
            self._name,
            *self.box.parts,
            name='sweep', **wide,
        )  # fmt: skip

    def _number(self, title: str, value: float, name: str) -> NumericInput:
        return NumericInput(
            title=title, value=value, mode='float', name=name, sizing_mode='stretch_width',
            min_width=60,
        )  # fmt: skip

    def _start(self) -> None:
        if not _NAME.match(self._name.value):
            raise PiezoError(
                f'{self._name.value!r} is no name of a bag: letters, digits, dots, dashes'
            )
        self._order(
            SweepOrder(
                numbers(self._frequencies.value, 'frequencies'),
                numbers(self._amplitudes.value, 'amplitudes'),
                float(self._seconds.value or 0.0),
                float(self._warm_up.value or 0.0),
                float(self._pause.value or 0.0),
                self._name.value,
            )
        )

    def refresh(self, job: BackgroundJob, offered: bool, now: float) -> None:
        """Show the state of the sweep; a new one gets a new name."""
        ended = self.box.bar.visible and not job.busy
        self.box.refresh(job, offered, self._hint, now)
        if ended:
            self._name.value = self._next_name()


class DiscoveryForm:
    """Records and baseline of a discovery."""

    def __init__(
        self,
        start: Callable[[DiscoveryOrder], None],
        cancel: Callable[[], None],
        bags: Callable[[], list[str]],
    ) -> None:
        self._order = start
        self._bags = bags
        found = bags()
        self._data = MultiSelect(
            title='recorded data', options=found, value=found[:1], name='discovery.data',
            sizing_mode='stretch_width', size=3,
        )  # fmt: skip
        self._baseline = Select(
            title='baseline model', value='classical', options=list(NAMES),
            name='discovery.baseline', sizing_mode='stretch_width',
        )  # fmt: skip
        self.box = JobBox('discovery', self._start, cancel)
        self.root: Any = Column(
            self._data, self._baseline, *self.box.parts, name='discovery',
            sizing_mode='stretch_width',
        )  # fmt: skip

    def _start(self) -> None:
        if not self._data.value:
            raise PiezoError('choose recorded data first; a sweep makes them')
        self._order(DiscoveryOrder(tuple(self._data.value), self._baseline.value))

    def look(self) -> None:
        """Update the list of recorded bags; the newest is selected automatically."""
        found = self._bags()
        if found == list(self._data.options):
            return
        new = [bag for bag in found if bag not in self._data.options]
        kept = [bag for bag in self._data.value if bag in found]
        self._data.update(options=found, value=new[:1] or kept)

    def refresh(self, job: BackgroundJob, now: float) -> None:
        """Show the state of the discovery."""
        self.box.refresh(job, True, '', now)


NO_MODEL = (
    '<p class="soft">No node uses a model: give the feedforward or the '
    'gap monitor a <code>model_file</code>.</p>'
)
# Number of plotted explanations: those that have been the most probable.
SHOWN = 5


class InvestigationForm:
    """Limits and budget of an investigation, its steps, and probabilities."""

    def __init__(
        self,
        start: Callable[[InvestigationOrder], None],
        cancel: Callable[[], None],
        next_name: Callable[[], str],
    ) -> None:
        self._order, self._next_name = start, next_name
        self._low = _number('low limit [V]', 'investigation.low')
        self._high = _number('high limit [V]', 'investigation.high')
        self._slew = _number('slew limit [V/s]', 'investigation.slew')
        self._budget = _number('budget [s]', 'investigation.budget', 200.0)
        self.box = JobBox('investigation', self._start, cancel)
        self._drawn: tuple[InvestigationState, ...] | None = None
        self._steps = text_div('investigation.steps')
        self._chances = ChancesPlot()
        wide = {'sizing_mode': 'stretch_width'}
        self.root: Any = Column(
            Row(self._low, self._high, self._slew, self._budget, **wide),
            *self.box.parts, self._steps, self._chances.figure,
            name='investigation', **wide,
        )  # fmt: skip

    def _start(self) -> None:
        low, high = self._low.value, self._high.value
        if reason := range_refusal(low, high):
            raise PiezoError(reason)
        slew, budget = float(self._slew.value or 0.0), float(self._budget.value or 0.0)
        if slew < 0.0 or budget < 0.0:
            raise PiezoError('neither the speed nor the budget can be below 0')
        self._order(InvestigationOrder(low or 0.0, high or 0.0, slew, budget, self._next_name()))

    def refresh(
        self, job: BackgroundJob, states: Sequence[InvestigationState], offered: bool, now: float
    ) -> None:
        """Show the state of the investigation."""
        self.box.refresh(job, offered, NO_MODEL, now)
        every = tuple(states)
        if every != self._drawn:
            self._drawn = every
            set_text(self._steps, steps_text(every))
            self._chances.show(every)


def _number(title: str, name: str, value: float | None = None) -> NumericInput:
    """Return an optional field; empty is the range of the actuator, or no limit."""
    return NumericInput(
        title=title, value=value, placeholder='auto', mode='float', name=name,
        sizing_mode='stretch_width', min_width=60,
    )  # fmt: skip


def steps_text(states: Sequence[InvestigationState]) -> str:
    """Return the experiments with reason and result, the newest first."""
    rows = [
        f'<tr><td>{state.number}</td><td><b>{escape(state.experiment)}</b>: '
        f'{escape(state.why)}<br><span class="good">{escape(state.answer)}</span></td></tr>'
        for state in states
        if state.number
    ]
    return f'<table>{"".join(reversed(rows))}</table>' if rows else ''


class ChancesPlot:
    """Probability of each explanation over the actuator time."""

    def __init__(self) -> None:
        self._x = Range1d(0.0, 10.0)
        self.figure = live_axes(
            'Present probabilities',
            'actuator time [s]',
            'probability',
            self._x,
            Range1d(-0.03, 1.05),
        )
        self.figure.name, self.figure.visible = 'investigation.chances', False
        self._sources = [ColumnDataSource({'x': [], 'y': []}) for _ in range(SHOWN)]
        self._lines = []
        for place, source in enumerate(self._sources):
            colour = PALETTE[place % len(PALETTE)]
            line = self.figure.line('x', 'y', source=source, color=colour, line_width=2)
            dots = self.figure.scatter('x', 'y', source=source, color=colour, size=6)
            self._lines.append([line, dots])
        self._legend = Legend(items=[], ncols=2, label_text_font_size='11px')
        self.figure.add_layout(self._legend, 'below')

    def show(self, states: Sequence[InvestigationState]) -> None:
        """Draw the probabilities before each experiment and after the last."""
        self.figure.visible = bool(states)
        best: dict[str, float] = {}
        for belief in states:
            for name, chance in belief.chances:
                best[name] = max(chance, best.get(name, 0.0))
        names = sorted(best, key=lambda name: -best[name])[:SHOWN]
        seconds = [belief.seconds for belief in states]
        self._x.update(start=0.0, end=max([10.0, *seconds]) * 1.05)
        for place, source in enumerate(self._sources):
            shown = names[place : place + 1]
            source.data = {
                'x': [x for _ in shown for x in seconds],
                'y': [dict(belief.chances).get(n, 0.0) for n in shown for belief in states],
            }
        self._legend.items = [
            LegendItem(label=name, renderers=self._lines[place])
            for place, name in enumerate(names)
        ]
