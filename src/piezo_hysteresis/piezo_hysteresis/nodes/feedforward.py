"""Feedforward by the inverse of the loaded model: the first link of the voltage chain."""

from __future__ import annotations

import sys

import numpy as np
from std_srvs.srv import Trigger

from piezo_hysteresis.compensation.choice import inverse_for
from piezo_hysteresis.compensation.inverse import InverseLink
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.nodes.link_node import LinkNode
from piezo_hysteresis.nodes.messages import parameters_from, point_from
from piezo_hysteresis.nodes.model_parameters import ModelParameters
from piezo_hysteresis.nodes.tables import FEEDFORWARD
from piezo_interfaces.msg import ModelEstimate, Reference
from piezo_interfaces.srv import LoadModel
from piezo_ros_common import topics
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.running import run_node


class Feedforward(LinkNode):
    """Answers every reference with the voltage that the model says it takes.

    Without a model it answers ``displacement / gain``: no compensation.
    """

    def __init__(self) -> None:
        super().__init__('feedforward', FEEDFORWARD, topics.VOLTAGE_FEEDFORWARD)
        self._last_sample = -1
        self._inverse: InverseLink | None = None
        self._chain: list[str] = []
        self._estimate: ModelEstimate | None = None
        self._model_parameters = ModelParameters(self.parameters)
        self._load_at_start(self.parameters.text('model_file'))
        self.create_subscription(Reference, topics.REFERENCE, self._on_reference, LOOP)
        self.create_subscription(ModelEstimate, topics.ESTIMATE, self._on_estimate, LATCHED)
        self.create_service(LoadModel, '~/load_model', self._on_load_model)
        self.create_service(Trigger, '~/use_estimate', self._on_use_estimate)
        self.autostart()

    def counters(self) -> dict[str, int]:
        """Return the counters of the inverse."""
        return {} if self._inverse is None else self._inverse.counters()

    # --- ticks ---------------------------------------------------------------------------------

    def _on_reference(self, message: Reference) -> None:
        if message.sample <= self._last_sample:
            self.pass_on_again(message.sample)
            return
        self._last_sample = message.sample
        self._follow_model()
        voltage = 0.0
        if self.active:
            if self._inverse is None:
                voltage = message.displacement / self.parameters.number('gain')
            else:
                voltage = self._inverse.step(point_from(message), 0.0, None)
        self.pass_on(message.header, message.sample, voltage)

    # --- models --------------------------------------------------------------------------------

    def _load_at_start(self, path: str) -> None:
        try:
            if path:
                self._model_parameters.load(ModelFile.load(path))
            self._take(self._model_parameters.take())
        except PiezoError as error:
            self.get_logger().fatal(str(error))
            raise SystemExit(2) from None

    def _follow_model(self) -> None:
        try:
            self._take(self._model_parameters.take())
        except PiezoError as error:
            self.get_logger().error(f'{error} (the model before stays in force)')

    def _take(self, loaded: ModelFile | None) -> None:
        """Invert `loaded` from now on; a model of the same chain goes over smoothly.

        Raises
        ------
        PiezoError
            If it cannot be inverted; the old one then stays.
        """
        if loaded is None:
            return
        chain = [block.name for block in loaded.model.blocks]
        if self._inverse is not None and chain == self._chain:
            self._inverse.set_parameters(loaded.values)
            return
        value = self.parameters.number
        self._inverse = inverse_for(
            loaded.model,
            loaded.values,
            self.dt,
            limits=self.limits(),
            start=value('start') if self._inverse is None else 0.0,
            transition=value('transition'),
        )
        self._chain = chain
        self._inverse.respond(np.zeros(3))  # compiles the kernel before the first tick
        self.get_logger().info(f'inverting {loaded.model.name or "the model"}: {", ".join(chain)}')

    def _on_load_model(
        self, request: LoadModel.Request, response: LoadModel.Response
    ) -> LoadModel.Response:
        try:
            loaded = (
                ModelFile.parse(request.yaml) if request.yaml else ModelFile.load(request.path)
            )
            self._model_parameters.load(loaded)
            self._take(self._model_parameters.take())
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
            self._model_parameters.load(ModelFile(named(message.model), parameters_from(message)))
            self._take(self._model_parameters.take())
        except PiezoError as error:
            return f'model/estimate cannot be used: {error}'
        return ''


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Feedforward))
