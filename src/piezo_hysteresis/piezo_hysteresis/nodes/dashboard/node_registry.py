"""Registry of running nodes and their described parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_hysteresis.dashboard.backend import Answer
from piezo_hysteresis.dashboard.controls import ParameterState, Value, described
from piezo_hysteresis.dashboard.live_state import Live, NodeState

TIMEOUT = 5.0  # for an answer [s]
# Short-lived nodes of command-line tools.
NOT_SHOWN = ('_', 'dashboard', 'launch_ros', 'ros2cli', 'rqt', 'transform_listener')


def from_ros(node: str, name: str, value: Any, about: ParameterDescriptor) -> ParameterState:
    """Return a parameter in the form of the page."""
    ranges = list(about.floating_point_range) + list(about.integer_range)
    bounds = (float(ranges[0].from_value), float(ranges[0].to_value)) if ranges else None
    return described(
        node,
        name,
        _plain(value),
        about.description,
        about.additional_constraints,
        bounds,
        about.read_only,
    )


def _plain(value: Any) -> Value:
    if isinstance(value, bool | int | float | str):
        return value
    return list(value) if value is not None else ''


class NodeRegistry:
    """Watches the nodes of one actuator."""

    def __init__(self, node: Node, live: Live) -> None:
        self._node, self._live = node, live
        self._clients: dict[str, AsyncParameterClient] = {}
        self._asked: dict[str, float] = {}  # nodes with a pending parameter request
        self._answers: list[tuple[float, str, Answer]] = []

    def look(self, present: set[str]) -> None:
        """Update the running nodes; request the parameters of new ones."""
        now = self._live.clock()
        nodes = self._live.nodes
        for name in present:
            state = nodes.get(name)
            if state is None or not state.present:
                nodes[name] = NodeState(name, True, now)
                self._asked.pop(name, None)
            if not nodes[name].parameters:
                self._ask(name)
        for name, state in list(nodes.items()):
            if state.present and name not in present:
                nodes[name] = replace(state, present=False, since=now)
        self._expire(now)

    def _client(self, name: str) -> AsyncParameterClient:
        if name not in self._clients:
            full = f'/{self._live.actuator}/{name}' if self._live.actuator else f'/{name}'
            self._clients[name] = AsyncParameterClient(self._node, full)
        return self._clients[name]

    def _ask(self, name: str) -> None:
        """Request all parameters of a node once its services are available."""
        now = self._live.clock()
        client = self._client(name)
        if now - self._asked.get(name, -TIMEOUT) < TIMEOUT or not client.services_are_ready():
            return
        self._asked[name] = now
        client.list_parameters(callback=lambda listed: self._listed(name, listed))

    def _listed(self, name: str, listed: Any) -> None:
        if listed.result() is None:
            return  # the node has ended, or a newer request is pending
        answer: ListParameters.Response = listed.result()
        names = [n for n in answer.result.names if not n.startswith('qos_overrides')]
        found: dict[str, Any] = {}

        def both(what: str) -> Callable[[Any], None]:
            def note(future: Any) -> None:
                found[what] = future.result()
                if len(found) == 2:
                    self._take_values(name, names, found)

            return note

        client = self._client(name)
        client.describe_parameters(names, callback=both('about'))
        client.get_parameters(names, callback=both('values'))

    def _take_values(self, name: str, names: list[str], found: Mapping[str, Any]) -> None:
        self._asked.pop(name, None)
        state = self._live.nodes.get(name)
        if state is None or None in found.values():
            return
        got: GetParameters.Response = found['values']
        descriptions: DescribeParameters.Response = found['about']
        values, about = got.values, descriptions.descriptors
        if not len(names) == len(values) == len(about):
            return  # the node has changed and a newer request is pending
        parameters = {
            key: from_ros(name, key, parameter_value_to_python(value), descriptor)
            for key, value, descriptor in zip(names, values, about, strict=True)
        }
        self._live.nodes[name] = replace(state, parameters=parameters)

    def follow(self, name: str, event: ParameterEvent) -> None:
        """Apply a parameter event of a node."""
        state = self._live.nodes.get(name)
        if state is None or not state.parameters:
            return
        ended = {p.name for p in event.deleted_parameters}
        known = {k: p for k, p in state.parameters.items() if k not in ended}
        strange = False
        for message in (*event.new_parameters, *event.changed_parameters):
            if message.name in known:
                value = _plain(parameter_value_to_python(message.value))
                known[message.name] = known[message.name].with_value(value)
            elif not message.name.startswith('qos_overrides'):
                strange = True
        self._live.nodes[name] = replace(state, parameters=known)
        if strange:
            self._ask(name)

    def set(self, name: str, values: Mapping[str, Value], answer: Answer) -> None:
        """Set parameters of a node; `answer` receives the first rejection."""
        state = self._live.nodes.get(name)
        if state is None or not state.present:
            answer.give(f'{name} is not there; start it first')
            return
        try:
            parameters = [RosParameter(key, value=value) for key, value in values.items()]
        except (TypeError, ValueError) as error:
            answer.give(str(error))
            return
        self._answers.append((self._live.clock() + TIMEOUT, name, answer))

        def answered(future: Any) -> None:
            if future.result() is None:
                return  # and thus reaches its timeout
            response: SetParameters.Response = future.result()
            refused = [r.reason or 'refused' for r in response.results if not r.successful]
            answer.give(refused[0] if refused else '')

        self._client(name).set_parameters(parameters, callback=answered)

    def _expire(self, now: float) -> None:
        for due, name, answer in self._answers:
            # a node that compiles for the change responds afterwards
            works = now < self._live.working.get(name, -TIMEOUT) + TIMEOUT
            if due < now and not works and not answer.done:
                answer.give(f'{name} did not answer within {TIMEOUT:g} s; see whether it runs')
        self._answers = [entry for entry in self._answers if not entry[2].done]


def shown(name: str) -> bool:
    """Return whether a node is shown."""
    return not name.startswith(NOT_SHOWN)
