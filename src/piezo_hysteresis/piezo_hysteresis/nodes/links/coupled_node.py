"""Feedforward and attenuation of several axes, and the last link of each."""

from __future__ import annotations

from rclpy.task import Future
from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.compensation.coupled import axes_chain
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.links.link_node import LinkNode
from piezo_hysteresis.parameters.links import COUPLED, VOLTAGE
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.starting import refuse_start
from piezo_hysteresis.runtime.coupled_ticks import CoupledLoop
from piezo_hysteresis.runtime.link_health import ALARMS, CHECKING, CORRECTS

_SENTENCES: dict[str, Finding] = {
    'refused_references': (Level.ERROR, 'a reference is not a number: the last one is held'),
    'no_inverse': (Level.WARN, 'the model has no voltage for the references: the last is held'),
    'not_finite': (Level.WARN, 'a sensor answers what is not a number'),
    'frozen': (Level.WARN, 'a sensor repeats the same reading'),
    'stuck_sensor': (Level.ERROR, 'a sensor is stuck: check the sensors'),
    'backed_off': (Level.ERROR, 'the correction increased the error: it restarts from 0'),
    'dropped': (Level.WARN, 'ticks are dropped: the reference of an axis never came'),
}


class VoltageLink(LinkNode):
    """The last link of an axis: its limits, watchdog and lifecycle.

    Parameters
    ----------
    axis : int
        Number of the axis, from 1.
    """

    def __init__(self, axis: int) -> None:
        output = topics.of_axis(topics.VOLTAGE_COMMAND, axis)
        source = topics.of_axis(topics.REFERENCE, axis)
        super().__init__(f'voltage_{axis}', VOLTAGE, output, source)
        self.autostart()

    def take(self, head: bytes, sample: int, voltage: float) -> None:
        """Limit and publish what is asked for one tick [V]; 0 V while it is not active."""
        self.pass_on(head, sample, 0.0, voltage if self.active else 0.0)


class Coupled(GuardedNode):
    """Parameters and health of the laws of all axes, see `runtime.coupled_ticks`."""

    def __init__(self) -> None:
        super().__init__('coupled')
        Diagnostics(self, self._judge)
        self.stop, self.exit_code = Future(), 0
        self.dropped = 0
        self.failed = ''  # why nothing is commanded any more, so that the watchdogs act
        self._loop: CoupledLoop | None = None
        self._links: list[VoltageLink] = []
        self._watch = CounterWatch(_SENTENCES)
        self.parameters = NodeParameters(self, COUPLED)
        try:
            self.model = axes_chain.loaded(self.parameters.text('model_file'))
        except PiezoError as error:
            refuse_start(error)
        self.create_service(Trigger, '~/reset', self._on_reset)

    @property
    def axes(self) -> int:
        """Number of axes of the model."""
        return self.model.layout.inputs

    def begin(self, links: list[VoltageLink]) -> CoupledLoop:
        """Return the laws for the limits of all axes, and serve their parameters."""
        self._links = links
        try:
            limits = [link.limits() for link in links]
            self._loop = CoupledLoop(self.model, self.parameters.values, limits)
        except PiezoError as error:
            refuse_start(error)
        assert self._loop is not None
        self.parameters.serve(self._apply)
        self.get_logger().info(
            f'{counted(self.axes, "axis")}, {counted(self.model.layout.modes, "mode")}: '
            + ', '.join(f'axis {i} {each.low:g} .. {each.high:g} V' for i, each in
                        enumerate(limits, 1))
        )  # fmt: skip
        return self._loop

    def go_safe(self, reason: str) -> None:
        """Command nothing, because a callback fails persistently: all voltages go to safety."""
        self.get_logger().error(f'all axes go to their safe voltage: {reason}')
        self.failed = reason

    def _apply(self, changes: dict[str, Value]) -> None:
        if self._loop is not None and changes:
            self._loop.use(self.parameters.values)
            self._cross_fade()

    def _cross_fade(self) -> None:
        for link in self._links:
            link.cross_fade()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._loop is not None:
            self._loop.reset_correction()
            self._cross_fade()
        self.failed = ''
        response.success, response.message = True, 'the correction restarts'
        return response

    def _judge(self) -> Health:
        if self._loop is None:
            return Health(Level.OK, 'starts')
        counts = {**self._loop.counters(), 'dropped': self.dropped}
        findings = self._watch.findings(counts)
        if self.failed:
            findings.append((Level.ERROR, f'no voltage is commanded: {self.failed}'))
        findings += [(Level.ERROR, text) for name, text in ALARMS.items() if counts.get(name)]
        work = CHECKING if self._loop.withheld else CORRECTS
        if self._loop.chain.attenuation is None:
            work = 'feedforward alone'
        return judge(findings, work, counts)
