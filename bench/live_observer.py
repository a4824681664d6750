"""Stores all messages of the live loop, at any load of the machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from piezo_hysteresis.common import topics
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.running import joined
from piezo_interfaces.msg import (
    ActuatorState,
    Gap,
    LoopStatus,
    ModelEstimate,
    Reference,
    VoltageCommand,
)

# Voltage between attenuation and feedback, where both are in the chain.
VOLTAGE_ATTENUATED = 'voltage/attenuated'

# Messages whose header says this are no genuine ones.
ROGUE = 'rogue'

Voice = ActuatorState | Reference | VoltageCommand | ModelEstimate | Gap | LoopStatus

# By what an observer knows that a node works: the topic that it alone publishes.
VOICES: dict[str, tuple[type[Voice], str, QoSProfile]] = {
    'simulator': (ActuatorState, topics.STATE, LOOP),
    'excitation': (Reference, topics.REFERENCE, LOOP),
    'feedforward': (VoltageCommand, topics.VOLTAGE_FEEDFORWARD, LOOP),
    'attenuation': (VoltageCommand, VOLTAGE_ATTENUATED, LOOP),
    'feedback': (VoltageCommand, topics.VOLTAGE_COMMAND, LOOP),
    'identification': (ModelEstimate, topics.ESTIMATE, LATCHED),
    'gap_monitor': (Gap, topics.GAP, LOOP),
    'recorder': (LoopStatus, 'recorder/status', LATCHED),
}
NODES = tuple(VOICES)

# How often the messages are taken in [s].
EVERY = 0.01


class State(NamedTuple):
    """One tick of the actuator as it was observed."""

    arrived: float  # when it was published [s], on the monotonic clock
    life: int  # how often the actuator was restarted before
    sample: int  # number of the tick
    voltage: float  # published values [V]
    displacement: float  # [m]


@dataclass
class Observed:
    """All received messages."""

    states: list[State] = field(default_factory=list)  # every tick of the actuator
    references: dict[int, float] = field(default_factory=dict)  # displacement wanted at a tick [m]
    commands: dict[int, float] = field(default_factory=dict)  # voltage commanded for a tick [V]
    received: dict[str, float] = field(default_factory=dict)  # [s]
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(NODES, 0))

    def discard(self) -> None:
        """Drop all but the newest samples, for runs that are long."""
        del self.states[:-1000]
        for book in (self.references, self.commands):
            for old in sorted(book)[:-1000]:
                del book[old]


class Observer:
    """Listens in a thread of its own, in the domain of the processes.

    Messages are taken from the middleware without an executor, which would cost more, and dated
    by the time stamps of the writers: a machine that is busy makes the observer late, not wrong.
    """

    def __init__(self, processes: NodeProcesses) -> None:
        self._context = joined(processes.domain)
        self.node = Node('observer', context=self._context)
        self._caller = Node('caller', context=self._context)
        self.seen = Observed()
        self.hooks: dict[str, Callable[[Voice], None]] = {}
        self._life = 0
        self._closing = False
        self._offset = time.time_ns() - time.monotonic_ns()
        self._inlets = [
            (name, topic, self.node.create_subscription(kind, topic, _unused, qos))
            for name, (kind, topic, qos) in VOICES.items()
        ]
        self._thread = threading.Thread(target=self._run, name='observer', daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing:
            for name, topic, subscription in self._inlets:
                with subscription.handle:
                    while got := subscription.handle.take_message(subscription.msg_type, False):
                        self._note(name, topic, got[0], got[1]['source_timestamp'])
            time.sleep(EVERY)

    def _note(self, name: str, topic: str, message: Voice, written: int) -> None:
        if message.header.frame_id == ROGUE:
            return
        now = 1e-9 * (written - self._offset)
        seen = self.seen
        seen.received[name] = now
        seen.counts[name] += 1
        if isinstance(message, ActuatorState):
            self._on_state(message, now)
        elif isinstance(message, Reference):
            seen.references[message.sample] = message.displacement
        elif isinstance(message, VoltageCommand) and name == 'feedback':
            seen.commands[message.sample] = message.voltage
        hook = self.hooks.get(topic)
        if hook is not None:
            hook(message)

    def _on_state(self, message: ActuatorState, now: float) -> None:
        states = self.seen.states
        if states and message.sample < states[-1].sample:
            self._life += 1
        states.append(
            State(now, self._life, message.sample, message.voltage, message.displacement)
        )

    def call(self, kind: type, service: str, request: Any, timeout: float = 30.0) -> Any:
        """Call a service; return its response, None without one."""
        client = self._caller.create_client(kind, service)
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._caller)
        try:
            if not client.wait_for_service(timeout):
                return None
            future = client.call_async(request)
            executor.spin_until_future_complete(future, timeout)
            return future.result() if future.done() else None
        finally:
            executor.shutdown()
            self._caller.destroy_client(client)

    def close(self) -> None:
        """Leave the domain."""
        self._closing = True
        self._thread.join()
        self.node.destroy_node()
        self._caller.destroy_node()
        rclpy.shutdown(context=self._context)


def _unused(_: object) -> None:
    """Never called: the messages are taken from the middleware."""
