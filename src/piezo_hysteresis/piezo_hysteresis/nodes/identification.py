"""Online identification by the papers' recursive least squares."""

from __future__ import annotations

import sys

from rclpy.node import Node
from std_srvs.srv import Trigger

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.nodes.messages import estimate_into
from piezo_hysteresis.nodes.tables import IDENTIFICATION
from piezo_interfaces.msg import ActuatorState, LoopStatus, ModelEstimate, RecordMarker
from piezo_ros_common import topics
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.running import run_node
from piezo_ros_common.table import Value

# Parameters that need a new start of the recursion when they change.
_SETTINGS = ('variant', 'offset', 'harmonic', 'frequency', 'forgetting', 'unit')


# Samples between two messages that tell a player how far the node is.
CONFIRM_EVERY = 64


class Identification(Node):
    """Takes every state of the actuator in and publishes what it knows of the model."""

    def __init__(self) -> None:
        super().__init__('identification')
        self._last_sample = -1
        self._taken = 0
        self._params = NodeParameters(self, IDENTIFICATION, self._apply, self._refuse)
        self._rls = OnlineRls(self._settings({}))
        self._warm_up()
        self._message = ModelEstimate()
        self._publisher = self.create_publisher(ModelEstimate, topics.ESTIMATE, LATCHED)
        self._status = LoopStatus(names='taken', counts=[0])
        self._status_publisher = self.create_publisher(LoopStatus, '~/status', LOOP)
        # Before the states: a marker that waits beside them is taken first.
        self.create_subscription(RecordMarker, topics.MARKER, self._on_marker, LOOP)
        self.create_subscription(ActuatorState, topics.STATE, self._on_state, LOOP)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _warm_up(self) -> None:
        """Compile the recursion before the first sample comes."""
        spare = OnlineRls(self._rls.settings)
        spare.update(0.0, 0.0)
        spare.estimate()

    def _on_state(self, message: ActuatorState) -> None:
        self._taken += 1
        if self._taken % CONFIRM_EVERY == 0:
            self._confirm()
        if message.sample <= self._last_sample:
            return
        self._last_sample = message.sample
        self._rls.update(message.voltage, message.displacement)
        if (message.sample + 1) % self._params.integer('publish_every') == 0:
            self._publish(message)

    def _on_marker(self, message: RecordMarker) -> None:
        self._last_sample = -1  # the next record may count its samples anew
        self._confirm()

    def _confirm(self) -> None:
        self._status.counts = [self._taken]
        self._status_publisher.publish(self._status)

    def _publish(self, state: ActuatorState) -> None:
        message = self._message
        message.header = state.header
        message.sample = state.sample
        message.method = 'rls'
        estimate_into(self._rls.estimate(), message)
        message.free_run_rms = float('nan')
        self._publisher.publish(message)

    def _settings(self, changes: dict[str, Value]) -> RlsSettings:
        known = self._params.values if hasattr(self, '_params') else {}
        chosen = {name: changes.get(name, known.get(name)) for name in _SETTINGS}
        rate = changes.get('rate', known.get('rate'))
        return RlsSettings(**chosen, dt=1.0 / float(rate))  # type: ignore[arg-type]

    def _refuse(self, changes: dict[str, Value]) -> str:
        try:
            self._settings(changes)
        except PiezoError as error:
            return str(error)
        return ''

    def _apply(self, changes: dict[str, Value]) -> None:
        if set(changes) == {'forgetting'}:
            self._rls.forgetting = self._params.number('forgetting')
        elif not changes.keys().isdisjoint(_SETTINGS):
            self._rls = OnlineRls(self._settings({}))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._rls.reset()
        response.success, response.message = True, 'the estimation starts anew'
        return response


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Identification))
