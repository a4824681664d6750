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
from piezo_hysteresis.dashboard.texts import job_text, set_text, start_text, text_div, time_text
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import NAMES
from piezo_hysteresis.reporting.plots import PALETTE

WIDE = {'sizing_mode': 'stretch_width'}
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


def _number(name: str, title: str, value: float | None = None) -> NumericInput:
    """Return a field for a number; empty is the range of the actuator, or no limit."""
    return NumericInput(
        title=title, value=value, placeholder='auto', mode='float', name=name, min_width=60, **WIDE
    )


class Form:
    """Fields of a job with its buttons, its progress and its message."""

    def __init__(
        self, kind: str, fields: Sequence[Any], send: Callable[[], None],
        cancel: Callable[[], None], *below: Any,
    ) -> None:  # fmt: skip
        self._send = send
        self._shown: tuple[BackgroundJob, bool, str] | None = None
        self._start = Button(label=f'Start {kind}', button_type='primary', name=f'{kind}.start')
        self._cancel = Button(label='Cancel', disabled=True, name=f'{kind}.cancel')
        self._bar = Progress(value=0, max=100, name=f'{kind}.bar', visible=False, **WIDE)
        self._words = text_div(f'{kind}.words')
        self._words.visible = False
        self._start.on_click(self._press)
        self._cancel.on_click(cancel)
        buttons = Row(self._start, self._cancel)
        self.root: Any = Column(
            *fields, buttons, self._bar, self._words, *below, name=kind, **WIDE
        )

    def _press(self) -> None:
        try:
            self._send()
        except PiezoError as error:
            self._show(f'<p class="error">{escape(str(error))}</p>')

    def show_job(self, job: BackgroundJob, now: float, hint: str = '') -> bool:
        """Show the state at `now`, or `hint` (HTML) without a node; return whether it ended."""
        spent = time_text(job, now)
        if self._shown == (job, bool(hint), spent):
            return False
        ended = bool(self._bar.visible) and not job.busy
        self._shown = (job, bool(hint), spent)
        self._start.disabled = job.busy or bool(hint)
        self._cancel.disabled = not job.busy
        self._bar.update(visible=job.busy, value=round(100 * job.fraction))
        self._show(job_text(job) + (f'<p class="soft">{spent}</p>' if spent else '') or hint)
        return ended

    def _show(self, text: str) -> None:
        self._words.update(text=text, visible=bool(text))


class SweepForm(Form):
    """Frequencies and amplitudes of a sweep, and the bag of its records."""

    def __init__(
        self,
        start: Callable[[SweepOrder], None],
        cancel: Callable[[], None],
        next_name: Callable[[], str],
        actuator: str = '',
    ) -> None:
        self._hint = start_text('No excitation offers sweeps.', 'excitation', actuator)
        self._next_name = next_name
        texts = {
            'frequencies': ('frequencies [Hz]', '1, 5, 10, 15, 20, 23, 40'),
            'amplitudes': ('amplitudes [V]', '1.0, 0.5'),
            'name': ('name of the bag', next_name()),
        }
        frequencies, amplitudes, name = [
            TextInput(title=title, value=value, name=f'sweep.{key}', **WIDE)
            for key, (title, value) in texts.items()
        ]
        self._name = name
        times = (
            _number('sweep.seconds', 'record length [s]', 3.0),
            _number('sweep.warm_up', 'warm-up [s]', 1.0),
            _number('sweep.pause', 'pause [s]', 0.0),
        )

        def send() -> None:
            if not _NAME.match(name.value):
                raise PiezoError(
                    f'{name.value!r} is no name of a bag: letters, digits, dots, dashes'
                )
            seconds, warm_up, pause = (float(each.value or 0.0) for each in times)
            start(
                SweepOrder(
                    numbers(frequencies.value, 'frequencies'),
                    numbers(amplitudes.value, 'amplitudes'),
                    seconds, warm_up, pause, name.value,
                )
            )  # fmt: skip

        super().__init__(
            'sweep', (frequencies, amplitudes, Row(*times, **WIDE), name), send, cancel
        )

    def refresh(self, job: BackgroundJob, offered: bool, now: float) -> None:
        """Show the state of the sweep; a new one gets a new name."""
        if self.show_job(job, now, '' if offered else self._hint):
            self._name.value = self._next_name()


class DiscoveryForm(Form):
    """Records and baseline of a discovery."""

    def __init__(
        self,
        start: Callable[[DiscoveryOrder], None],
        cancel: Callable[[], None],
        bags: Callable[[], list[str]],
    ) -> None:
        self._bags = bags
        found = bags()
        self._data = data = MultiSelect(
            title='recorded data', options=found, value=found[:1], name='discovery.data', size=3,
            **WIDE,
        )  # fmt: skip
        baseline = Select(
            title='baseline model', value='classical', options=list(NAMES),
            name='discovery.baseline', **WIDE,
        )  # fmt: skip

        def send() -> None:
            if not data.value:
                raise PiezoError('choose recorded data first; a sweep makes them')
            start(DiscoveryOrder(tuple(data.value), baseline.value))

        super().__init__('discovery', (data, baseline), send, cancel)

    def look(self) -> None:
        """Update the list of recorded bags; the newest is selected automatically."""
        found = self._bags()
        if found == list(self._data.options):
            return
        new = [bag for bag in found if bag not in self._data.options]
        kept = [bag for bag in self._data.value if bag in found]
        self._data.update(options=found, value=new[:1] or kept)


NO_MODEL = (
    '<p class="soft">No node uses a model: give the feedforward or the '
    'gap monitor a <code>model_file</code>.</p>'
)
# Number of plotted explanations: those that have been the most probable.
SHOWN = 5


class InvestigationForm(Form):
    """Limits and budget of an investigation, its steps, and probabilities."""

    def __init__(
        self,
        start: Callable[[InvestigationOrder], None],
        cancel: Callable[[], None],
        next_name: Callable[[], str],
    ) -> None:
        fields = (
            _number('investigation.low', 'low limit [V]'),
            _number('investigation.high', 'high limit [V]'),
            _number('investigation.slew', 'slew limit [V/s]'),
            _number('investigation.budget', 'budget [s]', 200.0),
        )
        self._drawn: tuple[InvestigationState, ...] | None = None
        self._steps = text_div('investigation.steps')
        self._chances = ChancesPlot()

        def send() -> None:
            if reason := range_refusal(fields[0].value, fields[1].value):
                raise PiezoError(reason)
            low, high, slew, budget = (float(each.value or 0.0) for each in fields)
            if slew < 0.0 or budget < 0.0:
                raise PiezoError('neither the speed nor the budget can be below 0')
            start(InvestigationOrder(low, high, slew, budget, next_name()))

        super().__init__(
            'investigation', (Row(*fields, **WIDE),), send, cancel, self._steps,
            self._chances.figure,
        )  # fmt: skip

    def refresh(
        self, job: BackgroundJob, states: Sequence[InvestigationState], offered: bool, now: float
    ) -> None:
        """Show the state of the investigation."""
        self.show_job(job, now, '' if offered else NO_MODEL)
        every = tuple(states)
        if every != self._drawn:
            self._drawn = every
            set_text(self._steps, steps_text(every))
            self._chances.show(every)


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
