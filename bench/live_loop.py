"""The whole loop as live processes.

What `bench/faults.py`, `bench/soak.py` and `bench/real_time.py` have in common.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bench.live_observer import VOICES, VOLTAGE_ATTENUATED
from piezo_hysteresis.common import topics
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.ros.processes import NodeProcess, NodeProcesses
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import joined
from piezo_interfaces.msg import ActuatorState

NODES = tuple(VOICES)


@dataclass(frozen=True)
class Setting:
    """How the loop is run."""

    rate: float = 100.0  # sampling rate [Hz]
    low: float = -1.0  # [V]
    high: float = 1.0  # [V]
    slew: float = 20.0  # [V/s]
    frequency: float = 1.0  # [Hz]
    amplitude: float = 6e-5  # [m]
    patience: float = 0.5  # silence after which links and simulator go to the safe voltage [s]
    clock: str = 'real_time'  # of the simulator: ``real_time`` or ``lock_step``

    @property
    def period(self) -> int:
        """Ticks of one period of the reference."""
        return round(self.rate / self.frequency)


class Loop:
    """Eight processes: five of the chain, and those that identify, compare and record."""

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
                'clock': s.clock,
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

    def start_twin(self, name: str) -> NodeProcess:
        """Start a second node of a kind, which writes to the same topics under another name."""
        remap = {
            'attenuation': {topics.VOLTAGE_COMMAND: VOLTAGE_ATTENUATED},
            'feedback': {topics.VOLTAGE_FEEDFORWARD: VOLTAGE_ATTENUATED},
        }.get(name)
        return self._processes.start(
            'piezo_hysteresis', name, self._parameters(name), name='twin', remap=remap
        )

    def end_twin(self, node: NodeProcess) -> None:
        """End it again."""
        node.signal(signal.SIGINT)
        node.wait(60.0)
        self._processes.retire(node)

    def end(self, name: str, number: int, again: float | None = None) -> tuple[int, str]:
        """End a node by a signal, sent twice where `again` [s] is given; return code and log."""
        node = self.running.pop(name)
        node.signal(number)
        if again is not None:
            time.sleep(again)
            node.signal(number)
        code = node.wait(60.0)
        text = node.log.read_text(errors='replace')
        self._processes.retire(node)
        return code, text

    def stop(self) -> dict[str, tuple[int, str]]:
        """End every node that runs, the last link first; return codes and logs."""
        return {name: self.end(name, signal.SIGINT) for name in reversed(tuple(self.running))}


class Crowd:
    """More subscribers of the state of the actuator, each a node, all served by one thread."""

    def __init__(self, processes: NodeProcesses, count: int) -> None:
        self._context = joined(processes.domain)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._nodes = [Node(f'listener_{k}', context=self._context) for k in range(count)]
        for node in self._nodes:
            node.create_subscription(ActuatorState, topics.STATE, lambda _: None, LOOP)
            self._executor.add_node(node)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        """Let them go."""
        self._over.set()
        self._thread.join()
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.shutdown(context=self._context)


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
