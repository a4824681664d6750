"""Feedforward by the inverse of the loaded model: the first link of the voltage chain."""

from __future__ import annotations

import sys
from dataclasses import replace

from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.stamps import SequenceFilter
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.nodes.links.link_node import LinkNode
from piezo_hysteresis.nodes.messages import measured_of, model_from, point_of, requested_model
from piezo_hysteresis.nodes.model_parameters import ModelParameters
from piezo_hysteresis.parameters.links import FEEDFORWARD
from piezo_hysteresis.ros.cdr_header import nanoseconds_of_head
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.ros.starting import refuse_start
from piezo_hysteresis.runtime.laws import Inversion, forward_settings
from piezo_interfaces.msg import ActuatorState, ModelEstimate, Reference
from piezo_interfaces.srv import LoadModel

# Period of the check for a missing reference [s].
LOOK = 0.1


class Feedforward(LinkNode):
    """Publishes for every reference the voltage from the inverse model.

    Without a model it publishes ``displacement / gain``: no compensation.

    Parameters
    ----------
    wired : bool
        Whether inputs come from topics; False if the same process calls the ``take_`` methods.
    """

    def __init__(self, *, wired: bool = True) -> None:
        output, source = topics.VOLTAGE_FEEDFORWARD, topics.REFERENCE
        super().__init__('feedforward', FEEDFORWARD, output, source)
        self._seen = -1
        self._states: Subscription | None = None
        self._ticks = SequenceFilter()
        self._estimate: ModelEstimate | None = None
        self._gain = self.parameters.number('gain')
        self._inversion = Inversion(forward_settings(self.parameters.values, self.dt))
        self._model_parameters = ModelParameters(self, self.parameters, self._take, self._refusal)
        self._load_at_start(self.parameters.text('model_file'))
        if wired:
            self.create_subscription(
                Reference, topics.REFERENCE, self._on_reference, LOOP, raw=True
            )
            wall_timer(self, LOOK, self._look)
        self.create_subscription(ModelEstimate, topics.ESTIMATE, self._on_estimate, LATCHED)
        self.create_service(LoadModel, '~/load_model', self._on_load_model)
        self.create_service(Trigger, '~/use_estimate', self._on_use_estimate)
        self.autostart()

    def counters(self) -> dict[str, int]:
        """Return the counters of the inverse."""
        return self._inversion.counters()

    def apply(self, changes: dict[str, Value]) -> None:
        """Apply accepted parameter changes."""
        super().apply(changes)
        self._gain = self.parameters.number('gain')
        self._inversion.change(
            forward_settings(self.parameters.values, self.dt),
            rebuild=any(k in ('transition', 'law') or k.startswith('limits.') for k in changes),
        )
        if 'follow_estimate' not in changes:
            self.cross_fade()

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return why the loaded model has no inverse by another law, '' if it has one."""
        if 'law' in changes:
            return self._inversion.refusal(str(changes['law']))
        return ''

    # --- ticks ---------------------------------------------------------------------------------

    def _on_reference(self, payload: bytes) -> None:
        self.take_reference(*point_of(payload))

    def take_reference(self, head: bytes, point: ReferencePoint) -> None:
        """Publish the voltage for the reference of one tick."""
        sample, newest = point.sample, self.intake.newest
        if not self.intake.take(sample):
            if sample == newest:
                self.pass_on_again(sample)
            return
        self.stamps.true_time(sample, nanoseconds_of_head(head))
        if sample <= newest:
            self._inversion.restart()
            self.restart_at(sample)
        voltage = self._inversion.voltage(point)
        if voltage is None:
            voltage = point.displacement / self._gain
        self.pass_on(head, sample, 0.0, voltage if self.active else 0.0)

    def take_state(self, head: bytes, measured: Measured) -> None:
        """Store the present tick of the actuator."""
        if self._ticks.take(measured.sample):
            self.watch(head, measured.sample)

    def _on_state(self, payload: bytes) -> None:
        self.take_state(*measured_of(payload))

    def _look(self) -> None:
        """Subscribe to the actuator only without a reference, to save a message per tick."""
        silent, self._seen = self.intake.newest == self._seen >= 0, self.intake.newest
        if silent and self._states is None:
            self._states = self.create_subscription(
                ActuatorState, topics.STATE, self._on_state, LOOP, raw=True
            )
            self._ticks = SequenceFilter()
        elif not silent and self._states is not None:
            self.destroy_subscription(self._states)
            self._states = None

    # --- models --------------------------------------------------------------------------------

    def _load_at_start(self, path: str) -> None:
        try:
            if path:
                self.load(ModelFile.load(path))
            self._model_parameters.follow()
        except PiezoError as error:
            refuse_start(error)

    def _refusal(self, loaded: ModelFile) -> str:
        return self._inversion.refusal(self.parameters.text('law'), loaded)

    def _take(self, loaded: ModelFile) -> None:
        """Use the inverse of `loaded`; if it has none, the previous model remains in use."""
        if not self._inversion.take(loaded):
            return
        self.cross_fade()
        chain = ', '.join(loaded.model.block_names)
        self.get_logger().info(f'inverting {loaded.model.name or "the model"}: {chain}')

    def load(self, loaded: ModelFile) -> None:
        """Make `loaded` the model; after an error the previous one and its parameters remain."""
        self._model_parameters.load(loaded)

    def _on_load_model(
        self, request: LoadModel.Request, response: LoadModel.Response
    ) -> LoadModel.Response:
        try:
            loaded = requested_model(request, self.parameters.text('model_folder'))
            self.load(loaded)
            response.success, response.message = True, f'inverts {loaded.model.name} now'
        except PiezoError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_estimate(self, message: ModelEstimate) -> None:
        self._estimate = message
        if self.parameters.flag('follow_estimate') and message.converged:
            reason = self._use(message)
            if reason:
                self.get_logger().warning(reason, throttle_duration_sec=5.0)

    def _on_use_estimate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._estimate is None:
            response.success = False
            response.message = 'no model/estimate has come yet: start the identification node'
            return response
        reason = self._use(self._estimate)
        response.success, response.message = not reason, reason or 'the estimate is in use'
        return response

    def _use(self, message: ModelEstimate) -> str:
        try:
            estimate = model_from(message)
            if message.frequency > 0.0 and message.amplitude > 0.0:
                estimate = self._with_drive(message, estimate)
            self.load(estimate)
        except PiezoError as error:
            return f'model/estimate cannot be used: {error}'
        return ''

    def _with_drive(self, message: ModelEstimate, estimate: ModelFile) -> ModelFile:
        """Return the schedule in use with the estimate of one drive in its place."""
        point = OperatingPoint(
            message.frequency, message.amplitude, message.travel, message.order, estimate
        )
        loaded = self._inversion.loaded
        known = loaded.schedule.points if loaded is not None and loaded.schedule else ()
        others = (each for each in known if each.name != point.name)
        return replace(estimate, schedule=Schedule((*others, point)))


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Feedforward))
