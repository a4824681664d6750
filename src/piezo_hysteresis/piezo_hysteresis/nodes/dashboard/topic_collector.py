"""The nodes of an actuator and the messages of its topics, for the page.

A callback per message would use as much processor time as a controller of the loop. The
subscriptions are therefore in no executor; they are polled at about 30 Hz.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterDescriptor, ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import nanoseconds_of
from piezo_hysteresis.dashboard.backend import Answer
from piezo_hysteresis.dashboard.controls import ParameterState, Value, described
from piezo_hysteresis.dashboard.live_state import (
    Counters,
    Gap,
    Live,
    LogLine,
    NodeState,
    ShownEstimate,
    State,
)
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import WORKS, state_of
from piezo_interfaces.msg import ActuatorState, LoopStatus, ModelEstimate, RecordMarker, Reference
from piezo_interfaces.msg import Gap as GapMessage

Message = TypeVar('Message')

# Nodes whose ~/status is shown.
COUNTING = ('feedforward', 'attenuation', 'feedback', 'identification', 'recorder')
EVENTS = QoSProfile(depth=1000)
MOST = 20000  # messages of one topic at a time


class Channel(Generic[Message]):
    """One topic: decodes received messages and forwards them."""

    def __init__(
        self,
        node: Node,
        kind: type[Message],
        topic: str,
        qos: QoSProfile,
        take: Callable[[list[Message]], None],
    ) -> None:
        self._kind, self._take = kind, take
        self._subscription = node.create_subscription(kind, topic, lambda _: None, qos)

    def poll(self) -> None:
        """Empty the queue."""
        handle = self._subscription.handle
        messages: list[Message] = []
        with handle:
            while len(messages) < MOST and (taken := handle.take_message(self._kind, True)):
                messages.append(deserialize_message(taken[0], self._kind))
        if messages:
            self._take(messages)


class TopicCollector:
    """All topics of one actuator."""

    def __init__(self, node: Node, live: Live) -> None:
        self._live = live
        self._prefix = f'/{live.actuator}/' if live.actuator else '/'
        self.counting = 'actuator'  # node that publishes the counters of the loop
        self.channels: dict[str, Channel[Any]] = {}
        self._receive(node, RecordMarker, topics.MARKER, LOOP, self._markers)
        self._receive(node, ActuatorState, topics.STATE, LOOP, self._states)
        self._receive(node, Reference, topics.REFERENCE, LOOP, self._references)
        self._receive(node, GapMessage, topics.GAP, LATCHED, self._gaps)
        self._receive(node, ModelEstimate, topics.ESTIMATE, LATCHED, self._estimates)
        self._receive(
            node, LoopStatus, topics.LOOP_STATUS, LATCHED, lambda m: self._count(self.counting, m)
        )
        for name in COUNTING:
            self._receive(node, LoopStatus, f'{name}/status', LATCHED, self._counter(name))

    def _receive(
        self,
        node: Node,
        kind: type[Message],
        short: str,
        qos: QoSProfile,
        take: Callable[[list[Message]], None],
    ) -> None:
        self.channels[short] = Channel(node, kind, self._prefix + short, qos, take)

    def topic(self, short: str) -> str:
        """Return the fully qualified name of a topic of this actuator."""
        return self._prefix + short

    def poll(self) -> None:
        """Process the received messages."""
        for channel in self.channels.values():
            channel.poll()

    def _counter(self, name: str) -> Callable[[list[LoopStatus]], None]:
        return lambda messages: self._count(name, messages)

    def _states(self, messages: list[ActuatorState]) -> None:
        self._live.note('state')
        self._live.signals.add_states(
            [
                State(m.sample, nanoseconds_of(m.header.stamp), m.voltage, m.displacement)
                for m in messages
            ]
        )

    def _references(self, messages: list[Reference]) -> None:
        self._live.note('reference')
        self._live.frequency = messages[-1].frequency
        self._live.signals.add_references(
            [m.sample for m in messages], [m.displacement for m in messages]
        )

    def _markers(self, messages: list[RecordMarker]) -> None:
        self._live.record = messages[-1].record
        self._live.record_frequency = messages[-1].frequency

    def _gaps(self, messages: list[GapMessage]) -> None:
        now = self._live.clock()
        for m in messages:
            self._live.gaps.append(
                Gap(
                    now, m.rms, m.noise_floor, m.floors, m.frequency, tuple(m.orders),
                    tuple(m.harmonics), m.beyond_floor, m.family,
                )
            )  # fmt: skip

    def _estimates(self, messages: list[ModelEstimate]) -> None:
        now = self._live.clock()
        for m in messages:
            self._live.estimates.append(
                ShownEstimate(
                    now, m.model, m.method, m.message, tuple(m.names), tuple(m.units),
                    tuple(m.values), tuple(m.standard_deviations), m.one_step_rms,
                    m.free_run_rms, m.converged,
                )
            )  # fmt: skip

    def _count(self, name: str, messages: list[LoopStatus]) -> None:
        m = messages[-1]
        counts = {
            key: getattr(m, key) for key in ('late', 'missed', 'refused', 'limited', 'doubled')
        }
        named = zip(m.names, m.counts, strict=False)
        counts |= dict(named)
        self._live.counters[name] = Counters(self._live.clock(), m.sample, m.rate, counts)


class SharedTopics:
    """The topics that all actuators share: log, diagnostics, parameter events."""

    def __init__(
        self,
        node: Node,
        lives_of: Callable[[str], Iterable[tuple[Live, str]]],
        on_event: Callable[[ParameterEvent], None],
    ) -> None:
        self._lives_of, self._on_event = lives_of, on_event
        self._channels = (
            Channel(node, ParameterEvent, '/parameter_events', EVENTS, self._events),
            Channel(node, Log, '/rosout', EVENTS, self._logs),
            Channel(node, DiagnosticArray, '/diagnostics', EVENTS, self._diagnostics),
        )

    def poll(self) -> None:
        """Process the received messages."""
        for channel in self._channels:
            channel.poll()

    def _events(self, messages: list[ParameterEvent]) -> None:
        for message in messages:
            self._on_event(message)

    def _logs(self, messages: list[Log]) -> None:
        for message in messages:
            if message.level < 30:  # warnings and errors
                continue
            level = 'warning' if message.level < 40 else 'error'
            for live, name in self._lives_of('/' + message.name.replace('.', '/')):
                live.words.append(LogLine(live.clock(), name, level, message.msg))

    def _diagnostics(self, messages: list[DiagnosticArray]) -> None:
        for message in messages:
            for status in message.status:
                for live, name in self._lives_of(status.name):
                    level = {b'\x00': 'ok', b'\x01': 'warning'}.get(status.level, 'error')
                    live.diagnostics[name] = LogLine(live.clock(), name, level, status.message)
                    if state_of(status) in WORKS:
                        live.working[name] = live.clock()


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
        self._full: dict[str, str] = {}  # full names of the nodes by their names on the page
        self._asked: dict[str, float] = {}  # nodes with a pending parameter request
        self._answers: list[tuple[float, str, Answer]] = []

    def look(self, present: Mapping[str, str]) -> None:
        """Update the running nodes, full names by those on the page; request their parameters."""
        self._full |= present
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
            self._clients[name] = AsyncParameterClient(self._node, self._full[name])
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
