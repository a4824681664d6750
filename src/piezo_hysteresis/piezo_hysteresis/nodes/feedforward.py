"""Feedforward by the inverse of the loaded model: the first link of the voltage chain."""

from __future__ import annotations

import sys

from std_srvs.srv import Trigger

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.inversion import Inversion
from piezo_hysteresis.nodes.link_node import LinkNode
from piezo_hysteresis.nodes.link_tables import FEEDFORWARD
from piezo_hysteresis.nodes.messages import model_from, point_from
from piezo_hysteresis.nodes.model_parameters import ModelParameters
from piezo_hysteresis.nodes.paths import inside
from piezo_interfaces.msg import ModelEstimate, Reference
from piezo_interfaces.srv import LoadModel
from piezo_ros_common import topics
from piezo_ros_common.order import started_anew
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.running import run_node
from piezo_ros_common.table import Value


class Feedforward(LinkNode):
    """Answers every reference with the voltage that the model says it takes.

    Without a model it answers ``displacement / gain``: no compensation.
    """

    def __init__(self) -> None:
        super().__init__('feedforward', FEEDFORWARD, topics.VOLTAGE_FEEDFORWARD)
        self._last_sample = -1
        self._estimate: ModelEstimate | None = None
        value = self.parameters.number
        self._inversion = Inversion(self.dt, self.limits(), value('start'), value('transition'))
        self._model_parameters = ModelParameters(self.parameters)
        self._load_at_start(self.parameters.text('model_file'))
        self.create_subscription(Reference, topics.REFERENCE, self._on_reference, LOOP)
        self.create_subscription(ModelEstimate, topics.ESTIMATE, self._on_estimate, LATCHED)
        self.create_service(LoadModel, '~/load_model', self._on_load_model)
        self.create_service(Trigger, '~/use_estimate', self._on_use_estimate)
        self.autostart()

    def counters(self) -> dict[str, int]:
        """Return the counters of the inverse."""
        return self._inversion.counters()

    def apply(self, changes: dict[str, Value]) -> None:
        """Take accepted parameter changes over."""
        super().apply(changes)
        self._inversion.start = self.parameters.number('start')
        if any(name == 'transition' or name.startswith('limits.') for name in changes):
            self._inversion.rebuild(self.limits(), self.parameters.number('transition'))
        if 'follow_estimate' not in changes:
            self.go_over()

    # --- ticks ---------------------------------------------------------------------------------

    def _on_reference(self, message: Reference) -> None:
        if started_anew(message.sample, self._last_sample):
            self._inversion.forget()
            self.go_over()
        elif message.sample <= self._last_sample:
            self.pass_on_again(message.sample)
            return
        self._last_sample = message.sample
        self._follow_model()
        voltage = self._inversion.voltage(point_from(message))
        if voltage is None:
            voltage = message.displacement / self.parameters.number('gain')
        self.pass_on(message.header, message.sample, 0.0, voltage if self.active else 0.0)

    # --- models --------------------------------------------------------------------------------

    def _load_at_start(self, path: str) -> None:
        try:
            if path:
                self._model_parameters.load(ModelFile.load(path))
            self._take(self._model_parameters.take())
        except PiezoError as error:
            self.give_up(str(error))

    def _follow_model(self) -> None:
        try:
            self._take(self._model_parameters.take())
        except PiezoError as error:
            self.get_logger().error(f'{error} (the model before stays in force)')

    def _take(self, loaded: ModelFile | None) -> None:
        """Invert `loaded` from now on.

        Raises
        ------
        PiezoError
            If it cannot be inverted; the old one then stays.
        """
        if loaded is None or not self._inversion.take(loaded):
            return
        self.go_over()
        chain = ', '.join(loaded.model.block_names)
        self.get_logger().info(f'inverting {loaded.model.name or "the model"}: {chain}')

    def _load(self, loaded: ModelFile) -> None:
        """Make `loaded` the model; on any error the one before stays, in the parameters too.

        Raises
        ------
        PiezoError
            If it cannot be inverted.
        """
        before = self._inversion.loaded
        try:
            self._model_parameters.load(loaded)
            self._take(self._model_parameters.take())
        except PiezoError:
            if before is not None:
                self._model_parameters.load(before)
                self._model_parameters.take()
            raise

    def _on_load_model(
        self, request: LoadModel.Request, response: LoadModel.Response
    ) -> LoadModel.Response:
        try:
            if request.yaml:
                loaded = ModelFile.parse(request.yaml)
            else:
                folder = self.parameters.text('model_folder')
                loaded = ModelFile.load(inside(folder, request.path))
            self._load(loaded)
            response.success, response.message = True, f'inverts {loaded.model.name} now'
        except PiezoError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_estimate(self, message: ModelEstimate) -> None:
        self._estimate = message
        if self.parameters.flag('follow_estimate'):
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
            self._load(model_from(message))
        except PiezoError as error:
            return f'model/estimate cannot be used: {error}'
        return ''


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Feedforward))
