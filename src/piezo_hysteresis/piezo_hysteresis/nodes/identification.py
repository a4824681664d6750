"""Online identification: the papers' recursive least squares, or the well-posed recursions."""

from __future__ import annotations

import sys
from collections.abc import Callable

from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.stamps import nanoseconds_of
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.recursion import OnlineMethod
from piezo_hysteresis.nodes.messages import estimate_into, inside
from piezo_hysteresis.parameters.node_tables import IDENTIFICATION
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.runtime.identification_plan import (
    SETTINGS,
    RecordSegmenter,
    SegmentEdge,
    forgetting_of,
    new_method,
)
from piezo_interfaces.msg import ActuatorState, LoopStatus, ModelEstimate, RecordMarker
from piezo_interfaces.srv import SaveModel

# Samples and seconds between two progress reports to a player.
CONFIRM_EVERY = 64
CONFIRM_AFTER = 0.05

SENTENCES: dict[str, Finding] = {
    'refused': (Level.WARN, 'samples that are not numbers are left out'),
    'missed': (Level.WARN, 'samples are missing, the estimate is a little off'),
    'late': (Level.WARN, 'markers of records came long after the samples that they mark'),
    'unseen': (Level.WARN, 'the harmonic of a record lies beyond half the sampling rate'),
    'stamp_jumps': (Level.WARN, 'time stamps jump: the numbers of the samples hold'),
    'strays': (Level.WARN, 'samples are numbered far from the rest: is there a second actuator?'),
    'reordered': (Level.WARN, 'samples come out of order: is there a second actuator?'),
}


class IdentificationNode(GuardedNode):
    """Processes every state of the actuator and publishes the estimated model."""

    def __init__(self) -> None:
        super().__init__('identification')
        Diagnostics(self, self._judge)
        self._received = 0
        self._marked = 0
        self._params = NodeParameters(self, IDENTIFICATION)
        self._params.serve(self._apply, self._refuse)
        value = self._params
        self._course = RecordSegmenter(
            self._new_method(), value.number('rate'), value.flag('only_records'), self._renewing()
        )
        self._message = ModelEstimate()
        self._publisher = self.create_publisher(ModelEstimate, topics.ESTIMATE, LATCHED)
        self._status = LoopStatus(names=['taken', 'marked'], counts=[0, 0])
        self._status_publisher = self.create_publisher(LoopStatus, '~/status', LATCHED)
        self._status_publisher.publish(self._status)
        # Before the states: a marker that arrived with them is processed first.
        self.create_subscription(RecordMarker, topics.MARKER, self._on_marker, LOOP)
        self.create_subscription(ActuatorState, topics.STATE, self._on_state, LOOP)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SaveModel, '~/save', self._on_save)
        wall_timer(self, CONFIRM_AFTER, self._confirm)
        self._watch = CounterWatch(SENTENCES)

    def _new_method(self) -> OnlineMethod:
        """Return the method, compiled before it gets its first sample."""
        spare = new_method(self._params.values)
        spare.update(0.0, 0.0)
        spare.estimate()
        return new_method(self._params.values)

    def _renewing(self) -> Callable[[], OnlineMethod] | None:
        """Return what makes the method of a further drive, None for one of all drives."""
        return self._new_method if self._params.flag('per_frequency') else None

    def _on_state(self, message: ActuatorState) -> None:
        self._received += 1
        if self._received % CONFIRM_EVERY == 0:
            self._confirm()
        taken = self._course.take(
            message.sample,
            nanoseconds_of(message.header.stamp),
            message.voltage,
            message.displacement,
        )
        if taken and self._course.state.taken % self._params.integer('publish_every') == 0:
            self._publish(message)

    def _on_marker(self, message: RecordMarker) -> None:
        self._marked += 1
        stamp = nanoseconds_of(message.header.stamp)
        drive = message.frequency, message.amplitude, message.warm_up
        self._course.mark(SegmentEdge(stamp, message.record, *drive))
        self._confirm()

    def _confirm(self) -> None:
        """Publish the progress of this node for a player, if it has changed."""
        counts = [self._received, self._marked]
        if list(self._status.counts) != counts:
            self._status.counts = counts
            self._status_publisher.publish(self._status)

    def _judge(self) -> Health:
        course = self._course
        counts = {
            'refused': course.state.refused,
            'late': course.late,
            'unseen': course.unseen,
            'stamp_jumps': course.stamps.jumps,
            **course.intake.counters(),
        }
        newest, taken = course.intake.newest, course.state.taken
        fine = f'{counted(taken, "sample", "is")} used'
        if newest < 0:
            fine = 'waits for the first sample'
        values = {'sample': newest, 'taken': taken, 'marked': self._marked, **counts}
        return judge(self._watch.findings(counts), fine, values)

    def _publish(self, state: ActuatorState) -> None:
        estimate = self._course.method.estimate()
        message = self._message
        message.header = state.header
        message.sample = state.sample
        message.method = self._params.text('method')
        estimate_into(estimate, self._course.method.model(), message)
        message.free_run_rms = self._course.free_run_rms(estimate)
        message.converged = self._course.settled(estimate, message.free_run_rms)
        drive = self._course.drive
        message.frequency, message.amplitude = drive.frequency, drive.amplitude
        message.travel, message.order = drive.travel, drive.order
        self._publisher.publish(message)

    def _refuse(self, changes: dict[str, Value]) -> str:
        try:
            new_method({**self._params.values, **changes})
        except PiezoError as error:
            return str(error)
        return ''

    def _apply(self, changes: dict[str, Value]) -> None:
        self._course.only_records = self._params.flag('only_records')
        self._course.renew = self._renewing()
        if not changes.keys().isdisjoint(SETTINGS):
            self._course.change(self._new_method())
        elif 'forgetting' in changes:
            self._course.set_forgetting(forgetting_of(self._params.values))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._course.reset()
        response.success, response.message = True, 'the estimation restarts'
        return response

    def _on_save(
        self, request: SaveModel.Request, response: SaveModel.Response
    ) -> SaveModel.Response:
        try:
            path = inside(self._params.text('model_folder'), request.path)
            self._course.model_file(f'{self._params.text("method")}, online').save(path)
            response.success, response.message = True, f'saved as {path}'
        except PiezoError as error:
            response.success, response.message = False, str(error)
        return response


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(IdentificationNode))
