"""Form of an investigation: start, next experiment with its reason, probabilities over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from bokeh.models import Column, ColumnDataSource, Legend, LegendItem, NumericInput, Range1d, Row

from piezo_hysteresis.common.ranges import range_refusal
from piezo_hysteresis.dashboard.axes import live_axes
from piezo_hysteresis.dashboard.backend import InvestigationOrder
from piezo_hysteresis.dashboard.forms import JobBox
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState
from piezo_hysteresis.dashboard.texts import set_text, start_text, text_div
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.reporting.plot_parts import PALETTE

# Number of plotted explanations: those that have been the most probable.
SHOWN = 5


class InvestigationForm:
    """Limits and budget of an investigation, its steps, and probabilities."""

    def __init__(
        self,
        start: Callable[[InvestigationOrder], None],
        cancel: Callable[[], None],
        next_name: Callable[[], str],
        actuator: str = '',
    ) -> None:
        self._hint = start_text(
            'No discovery node is running.', 'discovery', actuator, 'model_file:=model.yaml'
        )
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
        self.box.refresh(job, offered, self._hint, now)
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
    rows = []
    for place, belief in enumerate(states):
        if belief.stage not in ('run', 'apply'):
            continue
        later = [each for each in states[place + 1 :] if each.number != belief.number]
        answer = later[0].answer if later else ''
        rows.append(
            f'<tr><td>{belief.number}</td><td><b>{escape(belief.experiment)}</b>: '
            f'{escape(belief.why)}'
            + (f'<br><span class="good">{escape(answer)}</span>' if answer else '')
            + '</td></tr>'
        )
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
