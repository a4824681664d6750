"""The controls of a page: parameters, sweep, discovery, and the state of the nodes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from functools import partial
from html import escape
from typing import Any

from bokeh.models import Column, Div, NumericInput, Row, Select, Slider, Switch, TextInput

from piezo_hysteresis.dashboard.backend import Answer, Backend
from piezo_hysteresis.dashboard.controls import (
    EFFECTS,
    ParameterState,
    Value,
    drive_parameters,
    effect_parameters,
    groups_of,
    reach,
    refusal_text,
)
from piezo_hysteresis.dashboard.forms import DiscoveryForm, InvestigationForm, SweepForm
from piezo_hysteresis.dashboard.texts import (
    SWITCH_STYLE,
    WIDGET_STYLE,
    set_text,
    status_text,
    text_div,
)

Send = Callable[[str, str, Value], Answer]
Find = Callable[[str, str], ParameterState | None]
REFUSAL_SHOWN = 20.0  # [s]


def reason_div(name: str) -> Div:
    """Return the empty element for the reason of a rejection."""
    return Div(
        text='', name=name, css_classes=['refusal'], stylesheets=[WIDGET_STYLE], visible=False
    )


class ParameterRow:
    """One parameter on the page."""

    def __init__(
        self,
        parameter: ParameterState,
        send: Send,
        siblings: Iterable[ParameterState] = (),
        shared: Div | None = None,
        prefix: str = '',
    ) -> None:
        self._parameter = parameter
        self._prefix = prefix
        self._send = send
        self._siblings = tuple(siblings)
        self._answer: Answer | None = None
        self._waiting: list[Value] = []
        self._quiet = False
        self._refused: float | None = None  # time of the rejection, and its element
        self._reason = shared or reason_div(f'{self.key}.reason')
        self._slider: Slider | None = None
        self._field: Any = None
        self.root = self._build() if shared is None else self._brief_switch()

    @property
    def key(self) -> str:
        """Node and name."""
        return f'{self._prefix}{self._parameter.node}.{self._parameter.name}'

    @property
    def _called(self) -> str:
        """Displayed name; with its node in a list of several nodes."""
        p = self._parameter
        name = escape(p.name)
        return name if self._prefix else f'<span class="soft">{escape(p.node)}</span> {name}'

    def _build(self) -> Any:
        p = self._parameter
        if p.is_switch:
            return self._switch()
        unit = f' <span class="unit">[{escape(p.shown_unit)}]</span>' if p.shown_unit else ''
        head = Div(
            text=f'<b>{self._called}</b>{unit} <span class="soft">{escape(p.sentence)}</span>',
            sizing_mode='stretch_width', stylesheets=[WIDGET_STYLE],
        )  # fmt: skip
        parts = self._number() if p.is_number else [self._state_text()]
        line = Row(*parts, sizing_mode='stretch_width')
        return Column(head, line, self._reason, sizing_mode='stretch_width', margin=(0, 0, 8, 0))

    def _new_switch(self, **options: Any) -> Switch:
        p = self._parameter
        widget = Switch(active=bool(p.value), name=f'{self.key}.switch', **options)
        widget.on_change('active', lambda _, __, new: self._changed(bool(new)))
        self._field = widget
        return widget

    def _brief_switch(self) -> Any:
        p = self._parameter
        label = (p.name.partition('.')[2] or p.name).replace('_', '_\u200b')  # may break there
        title = {'title': p.sentence}
        return self._new_switch(
            label=label, html_attributes=title, margin=(2, 0, 2, 0), stylesheets=[SWITCH_STYLE]
        )

    def _switch(self) -> Any:
        p = self._parameter
        label = Div(
            text=f'<b>{self._called}</b> <span class="soft">{escape(p.sentence)}</span>',
            sizing_mode='stretch_width', stylesheets=[WIDGET_STYLE], margin=(1, 0, 1, 0),
        )  # fmt: skip
        line = Row(self._new_switch(margin=(1, 6, 1, 0)), label, sizing_mode='stretch_width')
        return Column(line, self._reason, sizing_mode='stretch_width')

    def _number(self) -> list[Any]:
        p = self._parameter
        assert isinstance(p.value, int | float)
        span = reach(p, self._siblings)
        shown = p.factor * p.value
        slider = Slider(
            start=span.start, end=span.end, step=span.step,
            value=span.nearest(shown),
            show_value=False, title=None, sizing_mode='stretch_width', name=f'{self.key}.slider',
            margin=(8, 14, 0, 10), bar_color='#56b4e9',
        )  # fmt: skip
        box = NumericInput(
            value=_shortened(shown), mode='int' if isinstance(p.value, int) else 'float',
            width=100, name=f'{self.key}.number', margin=(0, 0, 0, 4),
        )  # fmt: skip
        slider.on_change('value', lambda _, __, new: self._typed(new))
        box.on_change('value', lambda _, __, new: self._typed(new))
        self._slider, self._field = slider, box
        return [slider, box]

    def _state_text(self) -> Any:
        p = self._parameter
        if p.choices:
            widget: Any = Select(value=str(p.value), options=list(p.choices))
        else:
            widget = TextInput(value=_text(p.value))
        widget.update(sizing_mode='stretch_width', name=f'{self.key}.word', margin=(0, 0, 0, 0))
        widget.on_change('value', lambda _, __, new: self._changed(p.parse(new)))
        self._field = widget
        return widget

    def _typed(self, new: float | None) -> None:
        if new is None:
            return
        p = self._parameter
        value = new / p.factor
        if isinstance(p.value, int):
            self._changed(round(value))
        else:
            # 23.0 µm is 2.3e-05 m, not 2.2999999999999997e-05 m
            self._changed(float(f'{value:.12g}'))

    def _changed(self, value: Value) -> None:
        if self._quiet or (value == self._parameter.value and self._answer is None):
            return
        self._waiting = [value]
        self._send_next()

    def _send_next(self) -> None:
        """Send the newest request after the previous one is answered."""
        if self._answer is None and self._waiting:
            self._parameter_wanted = self._waiting.pop()
            p = self._parameter
            self._answer = self._send(p.node, p.name, self._parameter_wanted)

    def refresh(self, find: Find) -> None:
        """Process the response, and changes by other clients."""
        if self._answer is not None:
            if not self._answer.done:
                return
            reason, self._answer = self._answer.reason, None
            refusal = refusal_text(self._parameter, reason)
            self._reason.update(text=escape(refusal), visible=bool(refusal))
            self._refused = time.monotonic() if reason else None
            if not reason:
                self._parameter = self._parameter.with_value(self._parameter_wanted)
            if self._waiting:
                self._send_next()
                return
            self._show()
            return
        if self._refused is not None and time.monotonic() - self._refused > REFUSAL_SHOWN:
            self._refused = None
            self._reason.update(text='', visible=False)
        found = find(self._parameter.node, self._parameter.name)
        if found is not None and found.value != self._parameter.value:
            self._parameter = found
            self._show()

    @contextlib.contextmanager
    def _silently(self) -> Iterator[None]:
        self._quiet = True
        try:
            yield
        finally:
            self._quiet = False

    def _show(self) -> None:
        """Set the widgets to the value of the node."""
        p = self._parameter
        with self._silently():
            if p.is_switch:
                self._field.active = bool(p.value)
            elif p.is_number:
                self._show_number()
            else:
                self._field.value = _text(p.value)

    def _show_number(self) -> None:
        p = self._parameter
        assert isinstance(p.value, int | float)
        assert self._slider is not None
        shown = p.factor * p.value
        if not self._slider.start <= shown <= self._slider.end:
            span = reach(p, self._siblings)
            self._slider.update(start=span.start, end=span.end, step=span.step)
        self._slider.value = min(max(shown, self._slider.start), self._slider.end)
        self._field.value = _shortened(shown)


def _shortened(value: float) -> float:
    return value if isinstance(value, int) else float(f'{value:.6g}')


def _text(value: Value) -> str:
    return ', '.join(str(v) for v in value) if isinstance(value, list) else str(value)


class RowList:
    """A list of parameters that is rebuilt only for other parameters."""

    def __init__(
        self,
        send: Send,
        find: Find,
        name: str,
        empty: str,
        *,
        brief: bool = False,
        prefix: str = '',
    ) -> None:
        self._prefix = prefix
        self._send, self._find = send, find
        self._shared = reason_div(f'{name}.reason') if brief else None
        self._rows: list[ParameterRow] = []
        self._keys: list[tuple[Any, ...]] = []
        self._hint = Div(text=empty, stylesheets=[WIDGET_STYLE], sizing_mode='stretch_width')
        classes = ['brief'] if brief else []
        self.root = Column(
            self._hint, sizing_mode='stretch_width', name=name, css_classes=classes,
            stylesheets=[WIDGET_STYLE],
        )  # fmt: skip

    def refresh(self, parameters: Iterable[ParameterState], all_of: Mapping[str, Any]) -> None:
        """Show `parameters`; `all_of` holds the parameters by node and name."""
        listed = list(parameters)
        # the form of a control depends on these and not on the value
        keys = [(p.node, p.name, type(p.value), p.low, p.high, p.choices) for p in listed]
        if keys != self._keys:
            self._keys = keys
            self._rows = [
                ParameterRow(p, self._send, _siblings(p, all_of), self._shared, self._prefix)
                for p in listed
            ]
            shown = [row.root for row in self._rows] or [self._hint]
            self.root.children = [*shown, self._shared] if self._shared else shown
        for row in self._rows:
            row.refresh(self._find)


def _siblings(parameter: ParameterState, all_of: Mapping[str, Any]) -> list[ParameterState]:
    known: Iterable[ParameterState] = all_of.get(parameter.node, {}).values()
    return [other for other in known if other.group == parameter.group]


NONE = '(general)'


class Controls:
    """Sliders, switches, forms and the state of the nodes."""

    def __init__(self, backend: Backend, actuator: str) -> None:
        self._live = backend.live(actuator)
        send, start = partial(_send, backend, actuator), partial(backend.start, actuator)
        find = self._live.parameter
        self._drive = RowList(send, find, 'drive', 'No excitation or controller is running.')
        self._effects = RowList(send, find, 'effects', 'No simulator is running here.', brief=True)
        self._all = RowList(send, find, 'all_rows', 'No parameters yet.', prefix='all.')
        self._node = Select(title='node', options=[], name='all.node')
        self._group = Select(title='group', options=[], name='all.group')
        self._sweep = SweepForm(
            start, partial(backend.cancel, actuator, 'sweep'),
            _new_name, actuator,
        )  # fmt: skip
        self._discovery = DiscoveryForm(
            start, partial(backend.cancel, actuator, 'discovery'), partial(backend.bags, actuator)
        )
        self._investigation = InvestigationForm(
            start, partial(backend.cancel, actuator, 'investigation'),
            partial(_new_name, 'investigation'),
        )  # fmt: skip
        self._status = text_div('status')
        choice = Row(self._node, self._group, sizing_mode='stretch_width')
        self.roots: list[Any] = [
            self._drive.root, self._effects.root, self._sweep.root, self._discovery.root,
            self._investigation.root,
            Column(choice, self._all.root, name='all', sizing_mode='stretch_width'), self._status,
        ]  # fmt: skip

    def refresh(self) -> None:
        """Update the controls from the nodes."""
        live = self._live
        parameters = live.parameters
        self._drive.refresh(drive_parameters(parameters), parameters)
        self._effects.refresh(effect_parameters(parameters), parameters)
        self._choose(parameters)
        self._sweep.refresh(live.sweep, live.sweeps_offered, live.clock())
        self._discovery.show_job(live.discovery, live.clock())
        offered = live.investigations_offered
        self._investigation.refresh(live.investigation, tuple(live.states), offered, live.clock())

    def show_state(self) -> None:
        """Show the state of the nodes, and the recorded data."""
        set_text(self._status, status_text(self._live))
        self._discovery.look()

    def _choose(self, parameters: Mapping[str, Mapping[str, ParameterState]]) -> None:
        nodes = sorted(parameters)
        _offer(self._node, nodes)
        own = parameters.get(self._node.value, {})
        groups = groups_of(p for p in own.values() if p.group != EFFECTS)
        _offer(self._group, [group or NONE for group in groups])
        chosen = self._group.value
        self._all.refresh(groups.get('' if chosen == NONE else chosen, []), parameters)


def _offer(select: Select, names: list[str]) -> None:
    if names != list(select.options):
        select.options = names
    if select.value not in names:
        select.value = names[0] if names else ''


def _send(backend: Backend, actuator: str, node: str, name: str, value: Value) -> Answer:
    return backend.set_parameters(actuator, node, {name: value})


def _new_name(kind: str = 'sweep') -> str:
    return datetime.now().strftime(f'{kind}_%Y-%m-%d_%H-%M-%S')
