"""What stands in for ROS in the tests of the live page."""

from __future__ import annotations

from typing import Any

import numpy as np

from piezo_hysteresis.dashboard.backend import Answer
from piezo_hysteresis.dashboard.controls import ParameterState, described
from piezo_hysteresis.dashboard.live_state import Live, NodeState, State


class Backend:
    """Stands in for ROS: takes every value up to 500."""

    def __init__(self, names: tuple[str, ...] = ('stage',)) -> None:
        self.names = list(names)
        self.lives: dict[str, Live] = {}
        self.sent: list[Any] = []
        self.orders: list[Any] = []

    def actuators(self) -> list[Any]:
        return self.names or ['']

    def allows(self, actuator: Any) -> bool:
        return True

    def live(self, actuator: str) -> Live:
        return self.lives.setdefault(actuator, live_at([0.0], actuator))

    def set_parameters(self, actuator: Any, node: Any, values: Any) -> Answer:
        ((name, value),) = values.items()
        answer = Answer()
        self.sent.append((node, name, value, answer))
        return answer

    def start(self, actuator: Any, order: Any) -> None:
        self.orders.append(order)

    def cancel(self, actuator: Any, kind: str) -> None:
        self.orders.append('cancel')

    def bags(self, actuator: Any) -> list[Any]:
        return ['first']


def live_at(time: list[Any], name: str = 'stage') -> Live:
    return Live(name, clock=lambda: time[0])


def amplitude(value: float = 1.0) -> ParameterState:
    return ParameterState('excitation', 'voltage.amplitude', value, 'Amplitude.', 'V', 0.0, 500.0)


def filled(backend: Any, name: str = 'stage') -> Any:
    live = backend.live(name)
    turn = 2 * np.pi * 0.01 * np.arange(5000)
    live.signals.add_references(list(range(5000)), list(5e-5 * np.sin(turn)))
    volts = np.sin(turn).tolist()
    live.signals.add_states(
        [State(k, k * 1_000_000, volt, 6e-5 * volt) for k, volt in enumerate(volts)]
    )
    live.note('state')
    live.note('reference')
    live.frequency = 10.0
    live.published = live.sweeps_offered = True
    live.nodes['excitation'] = NodeState(
        'excitation', True, 0.0, {'voltage.amplitude': amplitude()}
    )
    switch = described('simulator', 'effects.creep', False, 'Creeps.')
    live.nodes['simulator'] = NodeState('simulator', True, 0.0, {'effects.creep': switch})
    return live
