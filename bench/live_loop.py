"""The whole loop as live processes, and an observer that keeps every sample of it.

What `bench/faults.py`, `bench/soak.py` and `bench/real_time.py` have in common.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from piezo_hysteresis.models import ModelFile, named
from piezo_interfaces.msg import (
    ActuatorState,
    Gap,
    LoopStatus,
    ModelEstimate,
    Reference,
    VoltageCommand,
)
from piezo_ros_common import topics
from piezo_ros_common.processes import NodeProcess, NodeProcesses
from piezo_ros_common.qos import LATCHED, LOOP

# Voltage between attenuation and feedback, where both are in the chain.
VOLTAGE_ATTENUATED = 'voltage/attenuated'

# Messages whose header says this are no genuine ones.
ROGUE = 'rogue'

# By what an observer knows that a node works: the topic that it alone publishes.
VOICES: dict[str, tuple[type, str, Any]] = {
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
CHAIN = NODES[:5]


@dataclass(frozen=True)
class Setting:
    """How the loop is run.

    Attributes
    ----------
    rate : float
        Sampling rate [Hz].
    low, high, slew : float
        Limits of every link and of the simulator's input [V], [V], [V/s].
    frequency, amplitude : float
        The reference, a sinusoid [Hz], [m].
    patience : float
        Silence after which links and simulator go to the safe voltage [s]; so long that a machine
        that is busy with other things is not taken for a fault.
    """

    rate: float = 100.0
    low: float = -1.0
    high: float = 1.0
    slew: float = 20.0
    frequency: float = 1.0
    amplitude: float = 6e-5
    patience: float = 0.5

    @property
    def period(self) -> int:
        """Ticks of one period of the reference."""
        return round(self.rate / self.frequency)


class State(NamedTuple):
    """One tick of the actuator as it was observed.

    Attributes
    ----------
    arrived : float
        When [s], on the monotonic clock.
    life : int
        How often the actuator was started anew before.
    sample : int
        Number of the tick.
    voltage, displacement : float
        What it said [V], [m].
    """

    arrived: float
    life: int
    sample: int
    voltage: float
    displacement: float


@dataclass
class Observed:
    """Everything that was heard.

    Attributes
    ----------
    states : list of State
        Every tick of the actuator.
    references : dict
        Displacement wanted at a tick [m], of the newest run.
    commands : dict
        Voltage commanded for a tick [V], of the newest run.
    heard : dict
        When each node was last heard [s].
    counts : dict
        Messages of each node.
    """

    states: list[State] = field(default_factory=list)
    references: dict[int, float] = field(default_factory=dict)
    commands: dict[int, float] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(NODES, 0))

    def forget(self) -> None:
        """Drop all but the newest samples, for runs that are long."""
        del self.states[:-1000]
        for book in (self.references, self.commands):
            for old in sorted(book)[:-1000]:
                del book[old]


class Observer:
    """Listens in a thread of its own, in the domain of the processes.

    Parameters
    ----------
    processes : NodeProcesses
        Whose domain it joins.
    namespace : str
        Where the loop is.
    """

    def __init__(self, processes: NodeProcesses, namespace: str = '') -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=processes.domain)
        self.node = Node('observer', context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.seen = Observed()
        self._life = 0
        self._closing = False
        for name, (kind, topic, qos) in VOICES.items():
            self.node.create_subscription(kind, topic, self._listener(name), qos)
        self._thread = threading.Thread(target=self._spin, name='observer', daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._closing:
            self._executor.spin_once(timeout_sec=0.1)

    def _listener(self, name: str) -> Callable[[Any], None]:
        seen = self.seen
        special: dict[str, Callable[[Any, float], None]] = {
            'simulator': self._on_state,
            'excitation': lambda m, _: seen.references.__setitem__(m.sample, m.displacement),
            'feedback': lambda m, _: seen.commands.__setitem__(m.sample, m.voltage),
        }
        more = special.get(name)

        def on_message(message: Any) -> None:
            if message.header.frame_id == ROGUE:
                return
            now = time.monotonic()
            seen.heard[name] = now
            seen.counts[name] += 1
            if more is not None:
                more(message, now)

        return on_message

    def _on_state(self, message: ActuatorState, now: float) -> None:
        states = self.seen.states
        if states and message.sample < states[-1].sample:
            self._life += 1
        states.append(
            State(now, self._life, message.sample, message.voltage, message.displacement)
        )

    def call(self, kind: type, service: str, request: Any, timeout: float = 30.0) -> Any:
        """Call a service from another thread than the observer's; None where nobody answers."""
        client = self.node.create_client(kind, service)
        end = time.monotonic() + timeout
        try:
            while not client.service_is_ready() and time.monotonic() < end:
                time.sleep(0.02)
            future = client.call_async(request)
            while not future.done() and time.monotonic() < end:
                time.sleep(0.01)
            return future.result() if future.done() else None
        finally:
            self.node.destroy_client(client)

    def close(self) -> None:
        """Leave the domain."""
        self._closing = True
        self._thread.join()
        self._executor.shutdown()
        rclpy.shutdown(context=self._context)


class Loop:
    """Eight processes: the five of the chain, and who identifies, compares and records.

    Parameters
    ----------
    processes : NodeProcesses
        Owner of the processes.
    folder : Path
        Where the model and the bags go.
    setting : Setting
        How the loop is run.
    more : mapping of str to mapping, optional
        Further parameters of a node.
    """

    def __init__(
        self,
        processes: NodeProcesses,
        folder: Path,
        setting: Setting,
        more: Mapping[str, Mapping[str, object]] | None = None,
    ) -> None:
        self.setting = setting
        self.running: dict[str, NodeProcess] = {}
        self.bags: list[Path] = []
        self._processes = processes
        self._folder = folder
        self._model = folder / 'model.yaml'
        self._more = more or {}
        model = named('bouc_wen_mode')
        ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(self._model)

    def _parameters(self, name: str) -> dict[str, object]:
        s = self.setting
        limits = {
            'limits.low': s.low,
            'limits.high': s.high,
            'limits.slew': s.slew,
            'watchdog': s.patience,
            'safe_ramp': 0.25 * s.slew,
        }
        own: dict[str, dict[str, object]] = {
            'simulator': {
                'command_slew': s.slew,
                'ramp': 0.25 * s.slew,
                'command_timeout': s.patience,
                'amplifier.range_low': s.low,
                'amplifier.range_high': s.high,
            },
            'excitation': {
                'mode': 'reference',
                'frequency': s.frequency,
                'reference.amplitude': s.amplitude,
                'ramp': 0.2,
                'deadline': 3600.0,
            },
            'feedforward': {**limits, 'model_file': str(self._model)},
            'attenuation': {**limits, 'method': 'afc', 'orders': [3]},
            'feedback': {**limits, 'method': 'pid', 'pid.integral': 3000.0},
            'identification': {
                'method': 'rls_ud',
                'only_records': False,
                'publish_every': round(0.2 * s.rate),
            },
            'gap_monitor': {'model_file': str(self._model), 'window': 0.5},
        }
        shared = {} if name == 'recorder' else {'rate': s.rate}
        return {**shared, **own.get(name, {}), **self._more.get(name, {})}

    def start(self, name: str) -> NodeProcess:
        """Start a node, or start it again where it has ended."""
        parameters = self._parameters(name)
        if name == 'recorder':
            self.bags.append(self._folder / f'bag_{len(self.bags)}')
            parameters['out'] = str(self.bags[-1])
        remap = {
            'attenuation': {topics.VOLTAGE_COMMAND: VOLTAGE_ATTENUATED},
            'feedback': {topics.VOLTAGE_FEEDFORWARD: VOLTAGE_ATTENUATED},
        }.get(name)
        package = 'piezo_sim' if name == 'simulator' else 'piezo_hysteresis'
        node = self._processes.start(package, name, parameters, remap=remap)
        self.running[name] = node
        return node

    def end(self, name: str, number: int, again: float | None = None) -> tuple[int, str]:
        """End a node by a signal, sent twice where `again` [s] is given; return code and log."""
        node = self.running.pop(name)
        node.signal(number)
        if again is not None:
            time.sleep(again)
            node.signal(number)
        code = node.wait(60.0)
        text = node.log.read_text(errors='replace')
        self._processes.forget(node)
        return code, text

    def stop(self) -> dict[str, tuple[int, str]]:
        """End every node that runs, the last link first; return codes and logs."""
        return {name: self.end(name, signal.SIGINT) for name in reversed(tuple(self.running))}


def wait_until(condition: Callable[[], bool], timeout: float, step: float = 0.01) -> bool:
    """Return whether `condition` came true within `timeout` seconds."""
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(step)
    return True


def end_on_terminate() -> None:
    """Let SIGTERM end this process as Ctrl-C does, so that its nodes end too."""

    def end(*_: object) -> None:
        raise SystemExit(1)

    signal.signal(signal.SIGTERM, end)
