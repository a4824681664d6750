"""Runs sweeps in a piezo controller; the work is in `piezo_hysteresis.drivers`."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from concurrent import futures
from pathlib import Path
from typing import Any

from rclpy.action import GoalResponse
from rclpy.task import Future

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import Health, Level, judge
from piezo_hysteresis.common.stamps import NANOSECONDS
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.drivers.addresses import FORMS, open_controller
from piezo_hysteresis.drivers.controller import Controller
from piezo_hysteresis.drivers.worker import (
    ControllerSweep,
    ControllerThread,
    SweepOutcome,
    SweepProgress,
)
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.messages import new_inside
from piezo_hysteresis.parameters.node_tables import GCS_DRIVER
from piezo_hysteresis.ros.guarded import GuardedNode, serve_action
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.ros.starting import refuse_start
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState

# Largest number of states in the queue.
_KEPT = 100


class GcsDriver(GuardedNode):
    """Serves ``run_sweep``, one goal at a time, and publishes the state of the actuator."""

    def __init__(self) -> None:
        super().__init__('gcs_driver')
        self._params = NodeParameters(self, GCS_DRIVER)
        if not self._params.text('controller'):
            refuse_start(f'no controller is given: controller:={FORMS}')
        self._bag = Path()
        self._folder = Path(self._params.text('folder')).expanduser()
        self._is_busy, self._last = False, ''
        self._counts = dict.fromkeys(('sweeps', 'sweeps_refused', 'sweeps_failed'), 0)
        self._states: deque[tuple[int, float, float]] = deque(maxlen=_KEPT)
        self._sample = 0
        self._message = ActuatorState()
        self._publisher = self.create_publisher(ActuatorState, topics.STATE, LOOP)
        every = 1.0 / self._params.number('monitor_rate')
        self._thread = ControllerThread(self._opened, self._note, every)
        self._params.serve(lambda changes: None)
        self._server = serve_action(self, RunSweep, 'run_sweep', self._judge_goal, self._execute)
        Diagnostics(self, self._judge)
        wall_timer(self, every, self._publish)

    def close(self) -> None:
        """Stop the running sweep, go to 0 V and disconnect."""
        self._thread.close()

    def _opened(self) -> Controller:
        """Connect, within the limits of the parameters."""
        params = self._params
        low, high = params.number('limits.low'), params.number('limits.high')
        is_given = low < high
        return open_controller(
            params.text('controller'),
            params.text('axis'),
            low if is_given else None,
            high if is_given else None,
            params.number('limits.slew') or None,
            params.number('timeout'),
            params.flag('take_over'),
        )

    def _note(self, voltage: float, displacement: float) -> None:
        """Queue a state for publication; called by the thread of the controller."""
        self._states.append((time.time_ns(), float(voltage), float(displacement)))

    def _publish(self) -> None:
        message = self._message
        while self._states:
            stamp, message.voltage, message.displacement = self._states.popleft()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
            message.sample = self._sample
            self._sample += 1
            self._publisher.publish(message)

    # --- sweeps --------------------------------------------------------------------------------

    def _judge_goal(self, goal: RunSweep.Goal) -> GoalResponse:
        if self._is_busy:
            reason = 'another one is running; cancel it first'
        else:
            try:
                self._bag = self._bag_of(goal)
                reason = self._thread.check(self._order(goal, self._bag))
            except PiezoError as error:
                reason = str(error)
        if reason:
            self.get_logger().error(f'sweep refused: {reason}')
            self._counts['sweeps_refused'] += 1
            self._last = f'refused: {reason}'
            return GoalResponse.REJECT
        self._is_busy = True
        return GoalResponse.ACCEPT

    def _order(self, goal: RunSweep.Goal, bag: Path) -> ControllerSweep:
        return ControllerSweep(
            bag,
            list(goal.frequencies),
            list(goal.amplitudes),
            goal.seconds,
            goal.warm_up,
            goal.pause,
            goal.waveform or 'sine',
            goal.options,
            self._params.text('actuator'),
        )

    async def _execute(self, goal: Any) -> RunSweep.Result:
        done, bag = Future(), self._bag
        self._counts['sweeps'] += 1
        try:
            running = self._thread.run(
                self._order(goal.request, bag),
                self._progress_callback(goal),
                lambda: goal.is_cancel_requested,
            )
            running.add_done_callback(lambda ended: self._hand_over(done, ended))
            outcome: SweepOutcome = await done
        finally:
            self._is_busy = False
        return self._result(goal, outcome, bag)

    def _hand_over(self, done: Future, ended: futures.Future[SweepOutcome]) -> None:
        """Pass a result to the thread that spins the node."""
        if error := ended.exception():
            self.run_later(done.set_exception, error)
        else:
            self.run_later(done.set_result, ended.result())

    def _progress_callback(self, goal: Any) -> Callable[[SweepProgress], None]:
        def report(now: SweepProgress) -> None:
            goal.publish_feedback(
                RunSweep.Feedback(
                    record=now.record,
                    frequency=now.frequency,
                    amplitude=now.amplitude,
                    seconds_left=now.seconds_left,
                    fraction=now.fraction,
                )
            )

        return report

    def _bag_of(self, goal: RunSweep.Goal) -> Path:
        """Return the bag of a goal, a new one if it names none, in the folder of the node."""
        if goal.bag:
            return new_inside(str(self._folder), goal.bag)
        taken = len(list(self._folder.glob('sweep_*'))) if self._folder.is_dir() else 0
        while (bag := self._folder / f'sweep_{taken + 1:04}').exists():
            taken += 1
        return bag

    def _result(self, goal: Any, outcome: SweepOutcome, bag: Path) -> RunSweep.Result:
        result = RunSweep.Result()
        count = len(outcome.records)
        result.records, result.names = count, [record.name for record in outcome.records]
        result.samples = sum(len(record) for record in outcome.records)
        result.bag = str(bag) if count else ''
        kept = (
            f'{counted(count, "record")} at {outcome.rate:g} Hz in {bag}' if count else 'no record'
        )
        if outcome.reason:
            goal.abort()
            self._counts['sweeps_failed'] += 1
            result.message = f'{outcome.reason}; {kept}'
        elif outcome.is_cancelled:
            goal.canceled()
            result.message = f'cancelled; the actuator is at rest; {kept}'
        else:
            goal.succeed()
            result.success, result.message = True, kept
        self._last = result.message
        return result

    def _judge(self) -> Health:
        thread = self._thread
        values = {**self._counts, 'losses': thread.losses, 'last_sweep': self._last}
        found = [(Level.ERROR, thread.problem)] if thread.problem else []
        fine = f'sweep: {thread.doing}' if thread.doing else 'is connected, at rest'
        return judge(found, fine, values)


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(GcsDriver))
