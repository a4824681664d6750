"""Forms to start a sweep and a discovery, with progress, cancel and result."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from typing import Any

from bokeh.models import (
    Button,
    Column,
    Div,
    MultiSelect,
    NumericInput,
    Progress,
    Row,
    Select,
    TextInput,
)

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, SweepOrder
from piezo_hysteresis.dashboard.live_state import BackgroundJob
from piezo_hysteresis.dashboard.template import WIDGET_STYLE
from piezo_hysteresis.dashboard.texts import job_text, start_text, time_text
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import NAMES

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
        actuator: str = '',
    ) -> None:
        self._hint = start_text('No discovery node is running.', 'discovery', actuator)
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

    def refresh(self, job: BackgroundJob, offered: bool, now: float) -> None:
        """Show the state of the discovery."""
        self.box.refresh(job, offered, self._hint, now)
