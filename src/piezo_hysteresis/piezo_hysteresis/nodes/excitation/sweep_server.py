"""The action ``run_sweep``: plan, markers and bag of a sweep."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.action import GoalResponse
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rclpy.task import Future

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import stamp_into
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.messages import new_inside
from piezo_hysteresis.nodes.recording.listeners import offered_as_yaml, subscribers
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of
from piezo_hysteresis.records.markers import CANCELLED, FAILED, REFUSED, sample_text
from piezo_hysteresis.records.recorder import Recorder, RecorderStatus
from piezo_hysteresis.ros.guarded import Guarded, serve_action
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import wall_timer
from piezo_hysteresis.runtime.sweep_plan import (
    ACTUATOR_RESTARTED,
    Sweep,
    SweepRecord,
    SweepRun,
    kept_message,
    narrowed,
    parse_options,
)
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import RecordMarker


def missing_subscribers(publisher: Publisher, topic: str, count: int) -> str:
    """Return required and present subscribers of a topic; empty if all are present."""
    there = publisher.get_subscription_count()
    return '' if there >= count else f'{count} subscribers of {topic}, {there} are there'


def undiscovered(node: Node, publisher: Publisher, topic: str, least: int) -> str:
    """Return the missing ones of at least `least` subscribers and of all in the graph."""
    count = max(least, subscribers(node, publisher.topic_name))
    return missing_subscribers(publisher, topic, count)


class SweepMarkers:
    """The markers of a sweep, and the bag of its states and markers."""

    def __init__(
        self, node: Node, parameters: NodeParameters, edge_at: Callable[[int], int], axis: int
    ) -> None:  # edge_at [ns]
        self._node, self._parameters, self._edge_at = node, parameters, edge_at
        self._state, self._marker = (
            topics.of_axis(each, axis) for each in (topics.STATE, topics.MARKER)
        )
        self._publisher = node.create_publisher(RecordMarker, self._marker, LOOP)
        self._recorder: Recorder | None = None
        self._numbers: list[int] = []
        self._queued = 0

    def missing(self) -> str:
        """Return the missing subscribers before the first tick; empty if all are connected."""
        least = self._parameters.integer('marker_listeners')
        return undiscovered(self._node, self._publisher, self._marker, least)

    def begin(self, bag: Path) -> None:
        """Start the recording."""
        recorder = Recorder(bag)
        self._numbers, self._queued = [], 0
        for short, kind in ((self._state, STATE), (self._marker, MARKER)):
            definition, type_hash = definition_of(kind)
            name, qos = self._node.resolve_topic_name(short), offered_as_yaml(LOOP)
            self._numbers.append(
                recorder.add_topic(name, kind, definition=definition, type_hash=type_hash, qos=qos)
            )
        self._recorder = recorder

    def state(self, payload: bytes) -> bool:
        """Record a state as received; return False if it had to be dropped."""
        return self._write(0, payload)

    def _write(self, topic: int, payload: bytes) -> bool:
        recorder = self._recorder
        if recorder is None:
            return True
        is_queued = recorder.write(self._numbers[topic], payload, time.time_ns())
        self._queued += is_queued
        return is_queued

    def close(self, *, empty: bool = False) -> RecorderStatus | None:
        """Finish the bag and return what is in it, if there is one; remove it if it is `empty`."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return None
        status = recorder.close()
        if empty:
            shutil.rmtree(recorder.path, ignore_errors=True)
        return status

    def mark(self, record: SweepRecord, sample: int) -> None:
        """Mark that a record begins at tick `sample`."""
        info = record.info
        marker = RecordMarker(record=record.name, excitation=info.excitation)
        marker.actuator = self._parameters.text('actuator')
        marker.frequency = info.frequency
        marker.amplitude = info.amplitude
        marker.warm_up = info.warm_up
        marker.input_unit = info.input_unit
        self._publish(marker, sample)

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Mark the end of a record at tick `sample`, or reject the record with a reason.

        Return the number of messages that the recording has accepted so far.
        """
        marker = RecordMarker(excitation=verdict)
        marker.header.frame_id = judged
        self._publish(marker, sample)
        return self._queued

    def _publish(self, marker: RecordMarker, sample: int) -> None:
        marker.rate = self._parameters.number('rate')
        marker.header.frame_id = marker.header.frame_id or sample_text(sample)
        stamp_into(marker.header.stamp, self._edge_at(sample))
        payload = serialize_message(marker)
        self._write(1, payload)
        self._publisher.publish(payload)


# Time between two feedback messages [s].
FEEDBACK_EVERY = 0.2

# Period of the check for subscribers that a sweep waits for [s].
LOOK_EVERY = 0.05
# Time in which a recorder that has just started is discovered, before a sweep without its own bag
# [s]. Without it, two of ten such recorders missed the first record.
DISCOVERY = 0.5


class SweepServer:
    """Runs sweeps for the excitation node."""

    def __init__(
        self,
        node: Guarded,
        parameters: NodeParameters,
        commands: Publisher,
        begin: Callable[[], None],
        resume: Callable[[], None],
        edge_at: Callable[[int], int],  # [ns]
        axis: int = 0,
    ) -> None:
        self._node = node
        self.last = ''
        self._axis = axis
        self._counts = dict.fromkeys(('sweeps', 'sweeps_refused', 'sweeps_failed'), 0)
        self._parameters = parameters
        self._commands = commands
        self._rate = parameters.number('rate')
        self._ticks_to_report = max(1, round(FEEDBACK_EVERY * self._rate))
        self._begin, self._resume = begin, resume
        self._busy = False
        self._run: SweepRun | None = None
        self._goal: Any = None
        self._done: Future | None = None
        self._newest = -1
        self._first = -1
        self._reason = ''
        self._ended: SweepRun | None = None
        self._bag = ''
        self._accepted = 0.0
        self._range = (0.0, 0.0)
        self._voltage = 0.0
        self._refused = self._refused_before = self._known_until = 0
        self._recount = False
        self._refuses = False
        self._markers = SweepMarkers(node, parameters, edge_at, axis)
        self._server = serve_action(
            node, RunSweep, topics.of_axis('run_sweep', axis), self._judge, self._execute
        )
        wall_timer(node, LOOK_EVERY, self._look)

    @property
    def active(self) -> bool:
        """Whether a sweep runs."""
        return self._run is not None

    @property
    def waits(self) -> bool:
        """Whether the actuator is at rest while the sweep waits for subscribers."""
        return bool(self.waits_for)

    @property
    def waits_for(self) -> str:
        """Awaited subscribers; empty if the sweep does not wait."""
        return self._missing() if self._run is not None and self._first < 0 else ''

    def _missing(self) -> str:
        """Return the missing subscribers before the first tick; empty if all are connected.

        The refusals that ended the previous sweep must be counted first, so that they are not
        attributed to this one.
        """
        if self._recount:
            return 'loop/status: what was refused of the sweep before is not known yet'
        if not self._bag and time.monotonic() - self._accepted < DISCOVERY:
            return 'recorders that have just started'
        return self._markers.missing() or undiscovered(
            self._node, self._commands, self._commands.topic_name, 1
        )

    @property
    def doing(self) -> str:
        """The running record and the remaining time of the sweep; empty without a sweep."""
        if self._run is None:
            return ''
        if self._newest < 0:
            return 'begins a sweep'
        sweep = self._run.sweep
        record, left = sweep.running(self._newest), sweep.seconds_left(self._newest)
        return f'sweep: {record.name}, {left:.0f} s left'

    def counters(self) -> dict[str, int]:
        """Return the numbers of started, refused and incomplete sweeps."""
        return dict(self._counts)

    @property
    def busy(self) -> bool:
        """Whether a sweep runs or is about to."""
        return self._busy

    def begins(self, sample: int) -> bool:
        """Return whether the sweep has started or may start with tick `sample`."""
        if self._first >= 0:
            return True
        assert self._run is not None
        if reason := self.beyond_range(*self._run.sweep.extremes):
            self._refuse(reason)
            return False
        if self._goal.is_cancel_requested:  # the awaited node may never start
            self._finish()
            return False
        if self._missing():
            return False
        if self._bag:
            try:
                self._markers.begin(Path(self._bag))
            except PiezoError as error:
                self._refuse(str(error))
                return False
        self._first = sample
        self._run.sweep.start(sample, self._voltage)
        return True

    def _refuse(self, reason: str) -> None:
        self._node.get_logger().error(f'sweep refused: {reason}')
        self._counts['sweeps_refused'] += 1
        self._reason, self._refuses = reason, True
        self._finish()

    def voltage(self, sample: int) -> float | None:
        """Return the voltage of tick `sample`, None after the end of the sweep."""
        run = self._run
        assert run is not None
        if self._goal.is_cancel_requested or self._reason:
            run.stop(sample, REFUSED if self._reason else CANCELLED)
        voltage = run.step(sample)
        if voltage is None:
            self._finish()
        else:
            if sample % self._ticks_to_report == 0:
                self._report(run.sweep, sample)
            self._newest = sample
        return voltage

    def over(self, sample: int) -> bool:
        """Return whether a sweep has started and tick `sample` is after its end."""
        return self._run is not None and self._first >= 0 and self._run.sweep.over(sample)

    def note_state(self, sample: int, voltage: float, payload: bytes) -> None:
        """Process and record a received state."""
        self._voltage = voltage
        if self._run is not None and self._first >= 0:
            self._run.add_state(sample, voltage, kept=self._markers.state(payload))

    def give_up(self, reason: str) -> None:
        """End the sweep because the actuator does not respond."""
        self._reason = reason
        if self._run is not None and self._first >= 0:
            self._run.stop(self._newest + 1, FAILED)
        self._finish()

    def follow_restart(self) -> None:
        """Restart the sweep with a restarted actuator, unless it has already started."""
        self._voltage = 0.0
        self._recount = False
        self._known_until = 0
        if self._run is not None and self._newest > self._first:
            self.give_up(ACTUATOR_RESTARTED)
        else:
            self._markers.close(empty=True)
            self._first = -1

    def note_range(self, low: float, high: float) -> None:
        """Store the command range of the actuator [V]; both limits are 0 if unknown."""
        self._range = (low, high)

    def beyond_range(self, low: float, high: float) -> str:
        """Return why commands from `low` to `high` [V] would be refused; empty if accepted."""
        least, most = self._range
        if least >= most or (least <= low and high <= most):
            return ''
        return f'it asks for {low:.4g} .. {high:.4g} V, but {narrowed(low, high, least, most)}'

    def note_refused(self, refused: int, sample: int) -> None:
        """Store the number of commands that the actuator refused before tick `sample`.

        The sweep returns to rest if one of its commands was refused; that record is rejected.
        """
        run = self._run
        if run is None or self._first < 0:
            self._recount = False
            self._refused_before = refused
        elif refused > self._refused_before and not self._reason:
            self._reason = (
                'the actuator refused '
                f'{counted(refused - self._refused_before, "command")}: the amplitude '
                'is beyond its range'
            )
            run.take_back(self._known_until, self._newest + 1, REFUSED)
        self._refused, self._known_until = refused, sample

    def _judge(self, goal: RunSweep.Goal) -> GoalResponse:
        reason = ''
        if self._axis:
            reason = 'the loop moves all axes at once; record an axis with references instead'
        elif self._busy:
            reason = 'another one is running; cancel it first'
        elif self._parameters.text('mode') != 'idle':
            reason = 'an experiment is running; set mode to idle first'
        else:
            try:
                self._plan = (self._planned(goal), self._path(goal))
            except PiezoError as error:
                reason = str(error)
        if reason:
            self._node.get_logger().error(f'sweep refused: {reason}')
            self._counts['sweeps_refused'] += 1
            self.last = f'refused: {reason}'
            return GoalResponse.REJECT
        self._busy = True
        return GoalResponse.ACCEPT

    def _planned(self, goal: RunSweep.Goal) -> Sweep:
        return Sweep(
            list(goal.frequencies),
            list(goal.amplitudes),
            goal.seconds,
            self._rate,
            warm_up=goal.warm_up,
            pause=goal.pause,
            waveform=goal.waveform or 'sine',
            options=parse_options(goal.options),
        )

    def _path(self, goal: RunSweep.Goal) -> str:
        """Return the bag of a goal, empty for none; it is new and in the folder of the node."""
        folder = self._parameters.text('folder')
        return str(new_inside(folder, goal.bag)) if goal.bag else ''

    async def _execute(self, goal: Any) -> RunSweep.Result:
        self._goal = goal
        self._first = self._newest = -1
        self._reason, self._refuses = '', False
        self._refused_before = self._refused
        self._done = Future()
        sweep, self._bag = self._plan
        self._accepted = time.monotonic()
        self._run = SweepRun(sweep, self._markers, recorded=bool(self._bag))
        self._counts['sweeps'] += 1
        try:
            self._begin()
            await self._done
            return self._result(goal)
        finally:
            if self._run is not None:  # it failed: the next goal finds the node free
                self._finish()

    def _result(self, goal: Any) -> RunSweep.Result:
        result = RunSweep.Result()
        result.samples = self._newest + 1 - self._first if self._newest >= 0 else 0
        assert self._ended is not None
        kept = self._ended.kept
        result.records = len(kept)
        result.names = [each.record.name for each in kept]
        result.bag = self._bag if result.samples else ''
        if self._reason:
            goal.abort()
            result.message = self._reason
        elif goal.is_cancel_requested:
            goal.canceled()
            result.message = 'cancelled; the actuator is at rest'
        else:
            goal.succeed()
            result.success = bool(kept)
            result.message = kept_message(self._ended, self._bag)
        self._counts['sweeps_failed'] += bool(self._reason) and not self._refuses
        self.last = result.message
        return result

    def _finish(self) -> None:
        self._ended, self._run = self._run, None
        assert self._done is not None
        try:
            self._note_stored(self._markers.close(empty=self._newest < 0))
        finally:
            self._recount = self._refused > self._refused_before
            self._busy = False
            if not self._done.done():
                self._done.set_result(True)

    def _note_stored(self, status: RecorderStatus | None) -> None:
        """Keep only records that are in the bag; fail if others were queued for it."""
        if status is None or self._ended is None:
            return
        lost = self._ended.drop_unwritten(status.written)
        if lost and not self._reason:
            kept = counted(len(self._ended.kept), 'record')
            self._reason = (
                f'{", ".join(lost)} could not be written ({status.problem or "writing stopped"}); '
                f'{kept} in {self._bag} can be read: free the disk, then run the others again'
            )

    def _look(self) -> None:
        """Continue once the awaited subscribers are connected."""
        if self._run is not None and self._first < 0:
            self._resume()

    def close(self) -> None:
        """Close the open recording."""
        self._markers.close()

    def _report(self, sweep: Sweep, sample: int) -> None:
        record = sweep.running(sample)
        feedback = RunSweep.Feedback()
        feedback.record = record.name
        feedback.frequency = record.info.frequency
        feedback.amplitude = record.info.amplitude
        feedback.seconds_left = sweep.seconds_left(sample)
        feedback.fraction = 1.0 - feedback.seconds_left * self._rate / sweep.length
        self._goal.publish_feedback(feedback)
