"""Experiments on live node processes: record a sweep, track a reference."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record, read_bag
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import LoopStatus
from piezo_ros_common import topics
from piezo_ros_common.middleware import joined
from piezo_ros_common.processes import NodeProcess, NodeProcesses, ProcessError
from piezo_ros_common.qos import LATCHED

Progress = Callable[[float, str], None]

START_UP = 60.0  # kernels are compiled the first time [s]


@dataclass(frozen=True)
class SweepOrder:
    """A sweep to record.

    Attributes
    ----------
    frequencies, amplitudes : sequence of float
        Every frequency [Hz] at every amplitude [V].
    seconds, warm_up : float
        Length of each record and the part that errors leave out [s].
    """

    frequencies: Sequence[float]
    amplitudes: Sequence[float]
    seconds: float
    warm_up: float


@dataclass(frozen=True)
class Tracking:
    """A reference to track.

    Attributes
    ----------
    frequency : float
        Of the sinusoid [Hz].
    amplitude, offset : float
        Of the reference [m].
    seconds : float
        Length [s].
    """

    frequency: float
    amplitude: float
    offset: float
    seconds: float


class Observer:
    """A node in this process that waits, watches and asks, in the domain of the processes."""

    def __init__(self, processes: NodeProcesses) -> None:
        self._processes = processes
        self._context = joined(processes.domain)
        self.node = Node('observer', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def until(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        """Serve until `condition` holds.

        Raises
        ------
        PiezoError
            If a process dies meanwhile or the time is over; the message says what was awaited.
        """
        end = time.monotonic() + timeout
        while not condition():
            try:
                self._processes.check()
            except ProcessError as error:
                raise PiezoError(str(error)) from None
            if time.monotonic() > end:
                raise PiezoError(f'{what} did not happen within {timeout:g} s; see the node logs')
            self._executor.spin_once(timeout_sec=0.05)

    def sweep(self, order: SweepOrder, progress: Progress) -> None:
        """Let the excitation run a sweep.

        Raises
        ------
        PiezoError
            If it is refused or fails.
        """
        client = ActionClient(self.node, RunSweep, 'run_sweep')
        self.until(client.server_is_ready, START_UP, 'the start of the excitation node')
        goal = RunSweep.Goal(
            frequencies=[float(f) for f in order.frequencies],
            amplitudes=[float(a) for a in order.amplitudes],
            seconds=order.seconds,
            warm_up=order.warm_up,
        )
        accepted = client.send_goal_async(
            goal,
            feedback_callback=lambda m: progress(m.feedback.fraction, m.feedback.record),
        )
        self.until(accepted.done, START_UP, 'the acceptance of the sweep')
        handle: Any = accepted.result()
        if not handle.accepted:
            raise PiezoError('the sweep was refused; the log of the excitation node says why')
        finished = handle.get_result_async()
        # A loaded machine runs a lock-step loop at a few hundred ticks per second at the least.
        seconds = order.seconds * len(order.frequencies) * len(order.amplitudes)
        self.until(finished.done, START_UP + 20.0 * seconds, 'the end of the sweep')
        result = finished.result().result
        if not result.success:
            raise PiezoError(f'the sweep failed: {result.message}')
        client.destroy()

    def watch_recorder(self) -> Callable[[], int]:
        """Return a function that tells how many messages the recorder has written."""
        written = [0]

        def on_status(message: LoopStatus) -> None:
            written[0] = message.sample

        self.node.create_subscription(LoopStatus, 'recorder/status', on_status, LATCHED)
        return lambda: written[0]


def _start_recorder(processes: NodeProcesses, bag: Path) -> NodeProcess:
    if bag.exists():
        shutil.rmtree(bag)
    bag.parent.mkdir(parents=True, exist_ok=True)
    return processes.start('piezo_hysteresis', 'recorder', {'out': str(bag)})


def _wait_for_recorder(observer: Observer, count: int) -> None:
    def recorded() -> bool:
        infos = observer.node.get_subscriptions_info_by_topic
        wanted = (topics.STATE, topics.REFERENCE, topics.MARKER)[:count]
        return all(any(i.node_name == 'recorder' for i in infos(f'/{topic}')) for topic in wanted)

    observer.until(recorded, START_UP, 'the start of the recorder')


def record_sweep(
    preset: str,
    order: SweepOrder,
    bag: Path,
    *,
    simulator: Mapping[str, object] | None = None,
    progress: Progress = lambda fraction, words: None,
) -> list[Record]:
    """Record a sweep of a simulated actuator over live processes and read it back.

    Parameters
    ----------
    preset : str
        Actuator to simulate.
    order : SweepOrder
        What to run.
    bag : Path
        Bag to create; one that is there is replaced.
    simulator : mapping, optional
        Further parameters of the simulator.
    progress : callable
        Told ``(fraction, words)``.

    Raises
    ------
    PiezoError
        If a process dies or the sweep fails.
    """
    with NodeProcesses() as processes, Observer(processes) as observer:
        settings = {'clock': 'lock_step', 'preset': preset, 'wait_for': 2, **(simulator or {})}
        processes.start('piezo_sim', 'simulator', settings)
        processes.start('piezo_hysteresis', 'excitation', {'actuator': preset})
        recorder = _start_recorder(processes, bag)
        _wait_for_recorder(observer, 3)
        observer.sweep(order, progress)
        time.sleep(0.3)  # what is still on its way to the recorder
        recorder.stop()
    return read_bag(bag)


def track(
    preset: str,
    tracking: Tracking,
    bag: Path,
    *,
    feedforward: Mapping[str, object],
    attenuation: Mapping[str, object],
    simulator: Mapping[str, object] | None = None,
) -> Record:
    """Track a reference over the live chain of processes and read the record back.

    Parameters
    ----------
    preset : str
        Actuator to simulate.
    tracking : Tracking
        The reference.
    bag : Path
        Bag to create; one that is there is replaced.
    feedforward, attenuation, simulator : mapping
        Parameters of the nodes.

    Raises
    ------
    PiezoError
        If a process dies or does not answer.
    """
    with NodeProcesses() as processes, Observer(processes) as observer:
        settings = {'clock': 'lock_step', 'preset': preset, 'wait_for': 3, **(simulator or {})}
        processes.start('piezo_sim', 'simulator', settings)
        processes.start('piezo_hysteresis', 'feedforward', dict(feedforward))
        processes.start('piezo_hysteresis', 'attenuation', dict(attenuation))
        recorder = _start_recorder(processes, bag)
        _wait_for_recorder(observer, 3)
        excitation = processes.start(
            'piezo_hysteresis',
            'excitation',
            {
                'mode': 'reference',
                'frequency': tracking.frequency,
                'reference.amplitude': tracking.amplitude,
                'reference.offset': tracking.offset,
                'duration': tracking.seconds,
                'exit_when_done': True,
                'wait_for': 3,
                'deadline': START_UP,
            },
        )
        patience = START_UP + 20.0 * tracking.seconds
        observer.until(
            lambda: excitation.returncode is not None, patience, 'the end of the experiment'
        )
        time.sleep(0.3)
        recorder.stop()
    return read_bag(bag)[0]
