"""The ``run_sweep`` action: one goal at a time, feedback on the way, at rest after a cancel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.sweep_plan import Sweep, SweepRecord, parse_options
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import RecordMarker
from piezo_ros_common import topics
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LOOP
from piezo_ros_common.stamps import stamp_into

# Time between two feedback messages [s].
FEEDBACK_EVERY = 0.2


def missing_subscribers(publisher: Publisher, topic: str, wanted: int) -> str:
    """Return how many subscribers a topic wants and has; empty where they are all there."""
    there = publisher.get_subscription_count()
    return '' if there >= wanted else f'{wanted} subscribers of {topic}, {there} are there'


class SweepServer:
    """Runs sweeps for the excitation node.

    Parameters
    ----------
    node : Node
        Whose action it is.
    parameters : NodeParameters
        Of the node: ``rate``, ``actuator``, ``mode``, ``marker_listeners``.
    begin : callable
        Called when a sweep is accepted, so that the node starts to emit.
    edge_at : callable
        Returns the time at which a tick begins for whoever reads the states of the actuator [ns].

    Attributes
    ----------
    last : str
        What became of the last sweep that was asked for.
    """

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        begin: Callable[[], None],
        edge_at: Callable[[int], int],
    ) -> None:
        self._node = node
        self._edge_at = edge_at
        self.last = ''
        self._counts = dict.fromkeys(('sweeps', 'sweeps_refused', 'sweeps_failed'), 0)
        self._parameters = parameters
        self._rate = parameters.number('rate')
        self._ticks_to_report = max(1, round(FEEDBACK_EVERY * self._rate))
        self._begin = begin
        self._busy = False
        self._sweep: Sweep | None = None
        self._goal: Any = None
        self._done: Future | None = None
        self._newest = -1
        self._first = -1
        self._reason = ''
        self._records_run = 0
        self._refused = self._refused_before = 0
        self._recount = False
        self._marker = RecordMarker(rate=self._rate)
        self._markers = node.create_publisher(RecordMarker, topics.MARKER, LOOP)
        self._server = ActionServer(
            node,
            RunSweep,
            'run_sweep',
            execute_callback=self._execute,
            goal_callback=self._judge,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    @property
    def active(self) -> bool:
        """Whether a sweep runs."""
        return self._sweep is not None

    @property
    def waits(self) -> bool:
        """Whether the sweep has not begun.

        Somebody is missing who shall hear markers, or the refusals that ended the sweep before
        have not all been counted yet and would be taken for refusals of this one.
        """
        return bool(self.waits_for)

    @property
    def waits_for(self) -> str:
        """Whom it waits for; empty where it does not wait."""
        if not self.active or self._first >= 0:
            return ''
        if self._recount:
            return 'loop/status: what was refused of the sweep before is not known yet'
        wanted = self._parameters.integer('marker_listeners')
        return missing_subscribers(self._markers, topics.MARKER, wanted)

    @property
    def doing(self) -> str:
        """The record that runs and how long the sweep still takes; empty without a sweep."""
        sweep = self._sweep
        if sweep is None:
            return ''
        if self._newest < 0:
            return 'begins a sweep'
        record, left = sweep.running(self._newest), sweep.seconds_left(self._newest)
        return f'sweep: {record.name}, {left:.0f} s left'

    def counters(self) -> dict[str, int]:
        """Return how many sweeps were begun, refused, and did not come to their end."""
        return dict(self._counts)

    @property
    def busy(self) -> bool:
        """Whether a sweep runs or is about to."""
        return self._busy

    def voltage(self, sample: int) -> float | None:
        """Return the voltage of tick `sample`, or None when the sweep is over."""
        sweep = self._sweep
        assert sweep is not None
        if self._first < 0:
            self._first = sample
            sweep.start(sample)
        if self._goal.is_cancel_requested or self._reason:
            sweep.cancel(sample)
        if sweep.over(sample):
            self._finish(sample)
            return None
        record = sweep.starting(sample)
        if record is not None:
            self._mark(record, sample)
        elif sweep.ending(sample):
            self._end_record(sample)
        if sample % self._ticks_to_report == 0:
            self._report(sweep, sample)
        self._newest = sample
        return sweep.voltage(sample)

    def give_up(self, reason: str) -> None:
        """End the sweep because the actuator does not answer."""
        self._reason = reason
        self._end_record(self._newest + 1)
        self._finish(self._newest)

    def follow_restart(self) -> None:
        """Begin again with an actuator that was started anew, unless some of it has been run."""
        self._recount = False
        if self.active and self._newest > self._first:
            self.give_up('the actuator was started anew during the sweep; run it again')
        else:
            self._first = -1

    def note_refused(self, refused: int) -> None:
        """Note how many commands the actuator has refused; return to rest if it is one of ours."""
        if not self.active or self._first < 0:
            self._recount = False
            self._refused_before = refused
        elif refused > self._refused_before and not self._reason:
            self._reason = (
                f'the actuator refused {refused - self._refused_before} commands: the amplitude '
                'is beyond its range'
            )
        self._refused = refused

    def _judge(self, goal: RunSweep.Goal) -> GoalResponse:
        reason = ''
        if self._busy:
            reason = 'another one is running; cancel it first'
        elif self._parameters.text('mode') != 'idle':
            reason = 'an experiment is running; set mode to idle first'
        else:
            try:
                self._planned(goal)
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

    async def _execute(self, goal: Any) -> RunSweep.Result:
        self._goal = goal
        self._first = self._newest = -1
        self._reason = ''
        self._refused_before = self._refused
        self._done = Future()
        self._sweep = self._planned(goal.request)
        self._counts['sweeps'] += 1
        self._begin()
        await self._done
        result = RunSweep.Result()
        result.samples = max(0, self._newest + 1 - self._first)
        result.records = self._records_run
        if self._reason:
            goal.abort()
            result.message = self._reason
        elif goal.is_cancel_requested:
            goal.canceled()
            result.message = 'cancelled; the actuator is at rest'
        else:
            goal.succeed()
            result.success = True
            result.message = f'{result.records} records'
        self._counts['sweeps_failed'] += bool(self._reason)
        self.last = result.message
        return result

    def _finish(self, sample: int) -> None:
        sweep, self._sweep = self._sweep, None
        assert sweep is not None
        assert self._done is not None
        self._recount = self._refused > self._refused_before
        ran = sample - self._first
        self._records_run = sum(record.last <= ran for record in sweep.records)
        self._busy = False
        self._done.set_result(True)

    def _mark(self, record: SweepRecord, sample: int) -> None:
        marker = self._marker
        marker.record = record.name
        marker.actuator = self._parameters.text('actuator')
        marker.excitation = record.info.excitation
        marker.frequency = record.info.frequency
        marker.amplitude = record.info.amplitude
        marker.warm_up = record.info.warm_up
        marker.input_unit = record.info.input_unit
        stamp_into(marker.header.stamp, self._edge_at(sample))
        self._markers.publish(marker)

    def _end_record(self, sample: int) -> None:
        marker = RecordMarker(rate=self._rate)
        stamp_into(marker.header.stamp, self._edge_at(sample))
        self._markers.publish(marker)

    def _report(self, sweep: Sweep, sample: int) -> None:
        record = sweep.running(sample)
        feedback = RunSweep.Feedback()
        feedback.record = record.name
        feedback.frequency = record.info.frequency
        feedback.amplitude = record.info.amplitude
        feedback.seconds_left = sweep.seconds_left(sample)
        feedback.fraction = 1.0 - feedback.seconds_left * self._rate / sweep.length
        self._goal.publish_feedback(feedback)
