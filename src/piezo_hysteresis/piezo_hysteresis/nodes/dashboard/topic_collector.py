"""Collects the messages of all topics of the page in batches.

A callback per message would use as much processor time as a controller of the loop. The
subscriptions are therefore in no executor; they are polled at about 30 Hz.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import nanoseconds_of
from piezo_hysteresis.dashboard.live_signals import State
from piezo_hysteresis.dashboard.live_state import Counters, Gap, Live, LogLine, ShownEstimate
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
        live_of: Callable[[str], tuple[Live | None, str]],
        on_event: Callable[[ParameterEvent], None],
    ) -> None:
        self._live_of, self._on_event = live_of, on_event
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
            live, name = self._live_of('/' + message.name.replace('.', '/'))
            if live is not None and message.level >= 30:  # warnings and errors
                level = 'warning' if message.level < 40 else 'error'
                live.words.append(LogLine(live.clock(), name, level, message.msg))

    def _diagnostics(self, messages: list[DiagnosticArray]) -> None:
        for message in messages:
            for status in message.status:
                live, name = self._live_of(status.name)
                if live is not None:
                    level = {b'\x00': 'ok', b'\x01': 'warning'}.get(status.level, 'error')
                    live.diagnostics[name] = LogLine(live.clock(), name, level, status.message)
                    if state_of(status) in WORKS:
                        live.working[name] = live.clock()
