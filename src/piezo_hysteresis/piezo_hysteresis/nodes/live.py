"""Experiments on live node processes: record a sweep, track a reference."""

from __future__ import annotations

import functools
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient

from piezo_hysteresis.common import topics
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record, read_bag
from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.processes import NodeProcess, NodeProcesses, ProcessError
from piezo_hysteresis.ros.qos import LATCHED
from piezo_hysteresis.ros.readiness import Neighbours
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import LoopStatus

Progress = Callable[[float, str], None]

# Time in which the topics of all axes are discovered after the first one [s].
SETTLED = 1.0
# Timeout of a wait without any progress [s].
STILL = 60.0


class Observer(Client):
    """A client node in this process, in the domain of the started processes."""

    def __init__(self, processes: NodeProcesses) -> None:
        self._processes = processes
        super().__init__('_observer', processes.domain)
        self._neighbours = Neighbours(self.node, everywhere=True)

    def until(
        self, condition: Callable[[], bool], what: str, moved: Callable[[], object] = lambda: None
    ) -> None:
        """Spin until `condition` holds, as long as there is progress."""
        still, before = time.monotonic(), object()

        def check() -> None:
            nonlocal still, before
            try:
                self._processes.check()
            except ProcessError as error:
                raise PiezoError(str(error)) from None
            now = (moved(), self._starting())
            if now != before:
                still, before = time.monotonic(), now
            if time.monotonic() - still > STILL:
                raise PiezoError(
                    f'{what} did not come: nothing has moved for {STILL:g} s; see the node logs'
                )

        self.wait(condition, check=check)

    def _starting(self) -> object:
        """Return a value that changes while nodes start: readiness, tasks and processor time."""
        names = [node.name for node in self._processes.nodes]
        ready = tuple(map(self._neighbours.is_ready, names))
        busy = (
            node.processor_time
            for node, is_ready in zip(self._processes.nodes, ready, strict=True)
            if not is_ready
        )
        return ready, self._neighbours.newest, tuple(busy)

    def until_ready(self, *names: str) -> None:
        """Wait until each of the nodes is ready."""
        for name in names:
            ready = functools.partial(self._neighbours.is_ready, name)
            self.until(ready, f'the start of the {name}')

    def axes(self) -> int:
        """Return the number of axes of the simulator that runs, 0 for an actuator of one."""

        def published(axis: int) -> bool:
            topic = topics.of_axis(topics.STATE, axis)
            return bool(self.node.count_publishers(f'/{topic}'))

        count, since = 0, time.monotonic()

        def settled() -> bool:
            nonlocal count, since
            if published(count + 1):
                count, since = count + 1, time.monotonic()
            return (published(0) or count > 0) and time.monotonic() - since > SETTLED

        self.until(settled, 'the state of the actuator')
        return count

    def sweep(self, fields: Mapping[str, Any], bag: Path, progress: Progress) -> None:
        """Request a recorded sweep from the excitation; `fields` are those of the goal."""
        client = ActionClient(self.node, RunSweep, 'run_sweep')
        self.until(client.server_is_ready, 'the action of the excitation')
        goal = RunSweep.Goal(**fields, bag=str(bag.resolve()))
        at = [0.0]

        def on_feedback(message: Any) -> None:
            feedback: RunSweep.Feedback = message.feedback
            at[0] = feedback.fraction
            progress(at[0], feedback.record)

        accepted = client.send_goal_async(goal, feedback_callback=on_feedback)
        self.until(accepted.done, 'the acceptance of the sweep')
        handle: Any = accepted.result()
        if not handle.accepted:
            raise PiezoError('the sweep was refused; see the log of the excitation node')
        finished = handle.get_result_async()
        self.until(finished.done, 'the end of the sweep', lambda: at[0])
        result: RunSweep.Result = finished.result().result
        if not result.success:
            raise PiezoError(f'the sweep failed: {result.message}')
        client.destroy()

    def watch_recorder(self) -> Callable[[], int]:
        """Return a function that returns the number of messages written by the recorder."""
        written = [0]

        def on_status(message: LoopStatus) -> None:
            written[0] = message.sample

        self.node.create_subscription(LoopStatus, 'recorder/status', on_status, LATCHED)
        return lambda: written[0]


def _make_room(bag: Path) -> None:
    if bag.exists():
        shutil.rmtree(bag)
    bag.parent.mkdir(parents=True, exist_ok=True)


def _start_recorder(processes: NodeProcesses, bag: Path) -> NodeProcess:
    _make_room(bag)
    return processes.start('piezo_hysteresis', 'recorder', {'out': str(bag)})


def _wait_for_recorder(observer: Observer) -> None:
    def recorded() -> bool:
        infos = observer.node.get_subscriptions_info_by_topic
        listed = (topics.STATE, topics.REFERENCE, topics.MARKER)
        return all(any(i.node_name == 'recorder' for i in infos(f'/{topic}')) for topic in listed)

    observer.until(recorded, 'the start of the recorder')


def record_sweep(
    preset: str,
    fields: Mapping[str, Any],  # of the goal
    bag: Path,
    progress: Progress = lambda fraction, words: None,
) -> list[Record]:
    """Record a sweep of a simulated actuator over live processes and read it back."""
    _make_room(bag)
    with NodeProcesses() as processes, Observer(processes) as observer:
        settings = {'clock': 'lock_step', 'preset': preset, 'wait_for': 1}
        processes.start('piezo_sim', 'simulator', settings)
        excitation = {'actuator': preset, 'folder': str(bag.resolve().parent)}
        processes.start('piezo_hysteresis', 'excitation', excitation)
        observer.until_ready('simulator', 'excitation')
        observer.sweep(fields, bag, progress)
    return read_bag(bag)


def track(
    preset: str,
    reference: Mapping[str, object],
    bag: Path,
    *,
    feedforward: Mapping[str, object],
    attenuation: Mapping[str, object],
) -> Record:
    """Track a reference over the live chain of processes and read the record back.

    Parameters are those of the nodes: the reference is made by the excitation.
    """
    with NodeProcesses() as processes, Observer(processes) as observer:
        settings = {'clock': 'lock_step', 'preset': preset, 'wait_for': 3}
        processes.start('piezo_sim', 'simulator', settings)
        processes.start('piezo_hysteresis', 'feedforward', dict(feedforward))
        processes.start('piezo_hysteresis', 'attenuation', dict(attenuation))
        recorder = _start_recorder(processes, bag)
        _wait_for_recorder(observer)
        observer.until_ready('simulator', 'feedforward', 'attenuation')
        written = observer.watch_recorder()
        excitation = processes.start(
            'piezo_hysteresis',
            'excitation',
            {
                'mode': 'reference',
                'exit_when_done': True,
                'wait_for': 3,
                'deadline': STILL,
                **reference,
            },
        )
        ended = 'the end of the experiment'
        observer.until(lambda: excitation.returncode is not None, ended, written)
        time.sleep(0.3)
        recorder.stop()
    record = read_bag(bag)[0]
    if record.reference is None:
        raise PiezoError(f'{bag} does not hold the reference of every sample')
    return record
