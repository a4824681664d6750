"""Runs one experiment on the actuator and records it: a sweep of one record, and a bag."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.subscription import Subscription

from piezo_common import topics
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation.experiments import PlannedExperiment
from piezo_hysteresis.nodes.investigation.neighbours_asked import PATIENCE, Cancelled, waited
from piezo_hysteresis.nodes.recording.offered_qos import offered_as_yaml
from piezo_hysteresis.nodes.recording.recorder_report import CONFIRM_AFTER, RecorderReport
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, RecordMarker
from piezo_ros_common.qos import LOOP
from piezo_ros_common.timers import wall_timer

# What is still on its way when a sweep ends, and how long an excitation may be away [s].
LAST_WORDS, AWAY = 0.4, 60.0
# How often an experiment is run at most, where the excitation or the actuator was started anew.
TRIES = 3
# Longer than a record the sweep may take: recorders are waited for, and slow machines [s].
LATE = 120.0


class _Lost(PiezoError):
    """The excitation, or the actuator, has gone or was started anew."""


class Sweeper:
    """Runs experiments by the action ``run_sweep``, and is the recorder of their bags.

    Parameters
    ----------
    node : Node
        That asks; it spins in another thread.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._client = ActionClient(node, RunSweep, 'run_sweep')
        self._report = RecorderReport(node)
        self._recorder: Recorder | None = None
        self._inlets: list[Subscription] = []
        wall_timer(node, CONFIRM_AFTER, self._report.tell_news)

    def run(self, experiment: PlannedExperiment, bag: Path, stopped: Callable[[], bool]) -> None:
        """Run an experiment into a new bag; begin again where the excitation was started anew.

        Raises
        ------
        Cancelled
            If it was `stopped`; the actuator is at rest then.
        PiezoError
            If it cannot be run.
        """
        for attempt in range(TRIES):
            try:
                self._once(experiment, bag, stopped)
                return
            except _Lost as lost:
                self._node.get_logger().warning(f'{lost}; it is run again when that is there')
                if attempt == TRIES - 1 or not waited(self._client.server_is_ready, stopped, AWAY):
                    raise

    def _once(self, experiment: PlannedExperiment, bag: Path, stopped: Callable[[], bool]) -> None:
        if not waited(self._client.server_is_ready, stopped):
            raise PiezoError('no excitation is running: start it, and investigate again')
        shutil.rmtree(bag, ignore_errors=True)
        self._on_node(lambda: self._record(bag))
        try:
            self._sweep(experiment, stopped)
            time.sleep(LAST_WORDS)
        finally:
            self._on_node(self._close)

    def _sweep(self, experiment: PlannedExperiment, stopped: Callable[[], bool]) -> None:
        goal = RunSweep.Goal(
            frequencies=[experiment.frequency],
            amplitudes=[experiment.amplitude],
            seconds=experiment.seconds,
            warm_up=experiment.prelude,
            waveform=experiment.spec['kind'],
            options=json.dumps({'parts': experiment.spec['parts']}),
        )
        sent = self._client.send_goal_async(goal)
        if not waited(sent.done, stopped):
            raise _Lost('the excitation does not answer')
        handle: Any = sent.result()
        if not handle.accepted:
            raise PiezoError('the excitation refused the experiment; its log says why')
        ended = handle.get_result_async()
        try:
            self._await(ended, experiment, stopped)
        except Cancelled:
            handle.cancel_goal_async()
            waited(ended.done, lambda: False)  # the actuator returns to rest meanwhile
            raise
        result = ended.result().result
        if not result.success:
            anew = 'anew' in result.message or 'not running' in result.message
            raise (_Lost if anew else PiezoError)(result.message)
        if not result.records:
            raise _Lost('the record was lost')

    def _await(
        self, ended: Any, experiment: PlannedExperiment, stopped: Callable[[], bool]
    ) -> None:
        gone: list[float] = []

        def over() -> bool:
            if self._client.server_is_ready():
                gone.clear()
            else:
                gone.append(time.monotonic())
            return bool(ended.done()) or bool(gone and gone[-1] - gone[0] > 0.5 * PATIENCE)

        waited(over, stopped, 10.0 * experiment.seconds + LATE)
        if not ended.done():
            raise _Lost('the excitation has gone')

    # --- the recorder, in the thread of the node -----------------------------------------------

    def _on_node(self, work: Callable[[], None]) -> None:
        """Do something in the thread that spins the node, and wait for it."""
        done, errors = threading.Event(), list[BaseException]()

        def task() -> None:
            try:
                work()
            except Exception as error:  # handed to whoever waits
                errors.append(error)
            finally:
                done.set()

        self._node.executor.create_task(task)
        done.wait()
        if errors:
            raise errors[0]

    def _record(self, bag: Path) -> None:
        recorder = self._recorder = Recorder(bag)
        kinds: tuple[tuple[str, str, Any, Callable[[bytes, bool], None]], ...] = (
            (topics.STATE, STATE, ActuatorState, self._report.on_state),
            (topics.MARKER, MARKER, RecordMarker, self._report.on_marker),
        )
        self._report.begin(lambda: recorder.status)
        for short, kind, message, count in kinds:
            definition, type_hash = definition_of(kind)
            name = self._node.resolve_topic_name(short)
            number = recorder.add_topic(
                name, kind, definition=definition, type_hash=type_hash, qos=offered_as_yaml(LOOP)
            )
            keep = partial(_kept, recorder, number, count)
            self._inlets.append(
                self._node.create_subscription(message, short, keep, LOOP, raw=True)
            )

    def _close(self) -> None:
        recorder, self._recorder = self._recorder, None
        for inlet in self._inlets:
            self._node.destroy_subscription(inlet)
        self._inlets.clear()
        self._report.end()
        if recorder is not None:
            recorder.close()

    def close(self) -> None:
        """Finish a recording that is under way."""
        self._close()


def _kept(
    recorder: Recorder, number: int, count: Callable[[bytes, bool], None], payload: bytes
) -> None:
    count(payload, recorder.write(number, payload, time.time_ns()))
