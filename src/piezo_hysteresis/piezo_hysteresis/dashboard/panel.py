"""The controls of a page: parameters, sweep, discovery, and the state of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import partial
from typing import Any

from bokeh.models import Column, Row, Select

from piezo_hysteresis.dashboard.backend import Answer, Backend
from piezo_hysteresis.dashboard.controls import (
    EFFECTS,
    ParameterState,
    Value,
    drive_parameters,
    effect_parameters,
    groups_of,
)
from piezo_hysteresis.dashboard.forms import DiscoveryForm, SweepForm
from piezo_hysteresis.dashboard.investigation_form import InvestigationForm
from piezo_hysteresis.dashboard.rows import RowList
from piezo_hysteresis.dashboard.texts import set_text, status_text, text_div

NONE = '(general)'


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
            _new_name, actuator,
        )  # fmt: skip
        self._discovery = DiscoveryForm(
            partial(backend.start_discovery, actuator),
            partial(backend.cancel_discovery, actuator),
            partial(backend.bags, actuator),
            actuator,
        )
        self._investigation = InvestigationForm(
            partial(backend.start_investigation, actuator),
            partial(backend.cancel_investigation, actuator),
            partial(_new_name, 'investigation'), actuator,
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
        self._discovery.refresh(live.discovery, live.discoveries_offered, live.clock())
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
