"""A link that compares the measurement with the reference: attenuation and feedback."""

from __future__ import annotations

import math
from collections.abc import Callable

from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.parameter_table import ParameterTable, Value
from piezo_hysteresis.common.stamps import SequenceFilter
from piezo_hysteresis.compensation.link import (
    CrossFade,
    Link,
    Measured,
    ReferencePoint,
    Transition,
)
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.links.link_node import LinkNode
from piezo_hysteresis.nodes.messages import VOLTAGE, measured_of, point_of, requested_model
from piezo_hysteresis.ros.cdr_header import nanoseconds_of_head
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.starting import refuse_start
from piezo_hysteresis.runtime.laws import LawMaker
from piezo_hysteresis.runtime.link_health import (
    CHECKING,
    CORRECTS,
    SWITCHED_OFF,
    SensorSign,
    StuckSensor,
)
from piezo_hysteresis.runtime.synchronizer import SampleSynchronizer, Tick
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand
from piezo_interfaces.srv import LoadModel


class TrackingNode(LinkNode):
    """Synchronizes reference, measurement and voltage of each tick and evaluates a control law.

    Parameters
    ----------
    name : str
        Of the node.
    table : ParameterTable
        Its parameters.
    laws : LawMaker
        Creates the law from the parameters, and applies changes to an existing one.
    report : callable, optional
        Creates for this node the function that is called after each published tick.
    output : str
        Topic of its output.
    wired : bool
        Whether inputs come from topics; False if the same process calls the ``take_`` methods.
    """

    def __init__(
        self,
        name: str,
        table: ParameterTable,
        laws: LawMaker,
        report: Callable[[TrackingNode], Callable[[Tick[bytes]], None]] | None = None,
        *,
        output: str = topics.VOLTAGE_COMMAND,
        wired: bool = True,
    ) -> None:
        super().__init__(name, table, output, topics.VOLTAGE_FEEDFORWARD)
        self._laws = laws
        self._model: ModelFile | None = None
        self._report = None if report is None else report(self)
        self._sign = SensorSign(self.dt)
        self._withheld = False
        try:
            path = self.parameters.text('model_file')
            self._model = ModelFile.load(path) if path else None
            self._install(self._built({}))
        except PiezoError as error:
            refuse_start(error)
        self._sensor = StuckSensor(self.dt)
        self._book: SampleSynchronizer[bytes] = SampleSynchronizer()
        self._started = False
        self._law_resets = self._refused_references = self._dropped = 0
        self._references, self._states = SequenceFilter(), SequenceFilter()
        self._held = ReferencePoint(0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if wired:
            self._subscribe()
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(LoadModel, '~/load_model', self._on_load_model)
        self.autostart()

    def _subscribe(self) -> None:
        for kind, topic, take in (
            (Reference, topics.REFERENCE, self._on_reference),
            (ActuatorState, topics.STATE, self._on_state),
            (VoltageCommand, topics.VOLTAGE_FEEDFORWARD, self._on_voltage),
        ):
            self.create_subscription(kind, topic, take, LOOP, raw=True)

    def new_fade(self) -> Transition:
        """Return the transition of the share; a new law starts with weight 0."""
        return CrossFade(self.dt, self.parameters.number('transition'))

    def _built(self, changes: dict[str, Value]) -> Link | None:
        return self._laws.build({**self.parameters.values, **changes}, self.dt, self._model)

    @property
    def work(self) -> str:
        """What the node does while it is active."""
        if self.law is None:
            return SWITCHED_OFF
        return CHECKING if self._withheld else CORRECTS

    def counters(self) -> dict[str, int]:
        """Return the counters of the law and of the reference."""
        law = {} if self.law is None else self.law.counters()
        own = {
            'law_reset': self._law_resets,
            'refused_references': self._refused_references,
            'dropped': self._dropped + self._book.dropped,
            'stuck_sensor': self._sensor.ticks,
            **(self._sign.counters() if self._withheld and self.active else {}),
        }
        return {**own, **law}

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return why there is no such law, '' if there is one."""
        try:
            self._built(changes)
        except PiezoError as error:
            return str(error)
        return ''

    def apply(self, changes: dict[str, Value]) -> None:
        """Apply changed parameters; a new law starts without a correction."""
        super().apply(changes)
        values = self.parameters.values
        self._reshape([name for name in changes if self._laws.shapes(values, name)])

    def _reshape(self, changed: list[str]) -> None:
        """Change the law, or create a new one if the parameters `changed` define its structure."""
        values = self.parameters.values
        if any(name.startswith('plant.') for name in changed):
            self._expect_plant()
        if changed and not self._laws.adjust(self.law, values, changed, self._model):
            self._install(self._built({}))
            self.cross_fade()

    def _install(self, law: Link | None) -> None:
        """Activate a law and log its properties."""
        self.law, self._withheld = self._ready(law), False
        self._expect_plant()
        remark = getattr(law, 'words', '')
        if remark:
            self.get_logger().info(remark)

    def _expect_plant(self) -> None:
        """Set the plant that the check of the sensor expects."""
        limits, model = self.limits(), self._model
        plant = self._laws.plant(self.parameters.values, self.dt, model)
        if plant is not None and plant.gain != 0.0:
            self._sign.expect(plant, limits.high - limits.low)

    @staticmethod
    def _ready(law: Link | None) -> Link | None:
        """Compile the kernels of `law` before it gets its first tick."""
        if law is not None:
            for k in range(3):
                point = ReferencePoint(k, 0.0, 0.0, 0.0, 1.0, 0.0)
                law.step(point, 0.0, Measured(k - 1, 0.0, 1e-9 * k))
            law.reset()
        return law

    # --- ticks ---------------------------------------------------------------------------------

    def take_reference(self, _: bytes, point: ReferencePoint) -> None:
        """Take the reference of one tick."""
        newest = self._references.newest
        if point.sample != newest and not self._references.take(point.sample):
            return
        if point.sample < newest:
            self._begin_book(point.sample)
        if math.isfinite(sum(point)):
            self._held = point
        else:
            self._refused_references += 1
            point = self._held._replace(sample=point.sample)
        self._book.add_reference(point)
        self._advance()

    def take_state(self, head: bytes, measured: Measured) -> None:
        """Take the measurement of one tick."""
        if self.take_measured(measured):
            self.check_state(head, measured)

    def take_measured(self, measured: Measured) -> bool:
        """Take the measurement of one tick; return whether `check_state` is to follow."""
        if not self._states.take(measured.sample):
            return False
        self._book.add_measured(measured)
        self._advance()
        return True

    def check_state(self, head: bytes, measured: Measured) -> None:
        """Check clock and sensor, and whether input stays away: what no command waits for."""
        self.stamps.true_time(measured.sample, nanoseconds_of_head(head))
        self._sensor.update(measured.voltage, measured.displacement)
        self._sign.update(measured.voltage, measured.displacement)
        self.watch(head, measured.sample)

    def take_voltage(self, head: bytes, sample: int, voltage: float) -> None:
        """Take the voltage of the previous link, for one tick [V]."""
        newest = self.intake.newest
        if not self.intake.take(sample) and sample != newest:
            return
        if sample < newest:
            self._begin_book(sample)
        if sample <= self._book.done:
            self.pass_on_again(sample)
            return
        self._book.add_voltage(sample, voltage, head)
        self._advance()

    def _on_reference(self, payload: bytes) -> None:
        self.take_reference(*point_of(payload))

    def _on_state(self, payload: bytes) -> None:
        self.take_state(*measured_of(payload))

    def _on_voltage(self, payload: bytes) -> None:
        head, (sample, voltage) = VOLTAGE.decode(payload)
        self.take_voltage(head, sample, voltage)

    def _begin_book(self, sample: int) -> None:
        """Restart, unless another message of the new run has already done so."""
        if sample <= self._book.done:
            self._sign.reset()
            self._dropped += self._book.dropped
            self._book = SampleSynchronizer()
            self._started = False
            self.restart_at(sample)
            if self.law is not None:
                self.law.reset()

    def _advance(self) -> None:
        while (tick := self._book.take()) is not None:
            if not self._started:
                self._started = True
                self._join(tick)
            self.pass_on(tick.tag, tick.point.sample, tick.received, self._asked(tick))
            if self._report is not None:
                self._report(tick)

    def _asked(self, tick: Tick[bytes]) -> float:
        """Evaluate the law [V]; values that are not finite are rejected."""
        if not self.active or self.law is None or not math.isfinite(tick.received):
            return tick.received
        voltage = self.law.step(tick.point, tick.received, tick.measured)
        if math.isfinite(voltage):
            return voltage if voltage == tick.received else self._closed(tick.received, voltage)
        self._law_resets += 1
        self._reset()
        return tick.received

    def _closed(self, received: float, voltage: float) -> float:
        """Return `voltage` once the sign of the sensor is known; until then the law restarts."""
        if not self.parameters.flag('sensor_check') or self._sign.may_close():
            if self._withheld:
                self._withheld = False
                self.cross_fade()
            return voltage
        self._withheld = True
        assert self.law is not None
        self.law.reset()
        return received

    def _join(self, tick: Tick[bytes]) -> None:
        """Start from the present voltage if the loop is already running."""
        if tick.measured is not None:
            self.start_at(tick.measured.voltage)
        elif tick.point.sample > 0:
            self.start_at(tick.received)

    # --- reset of the law ------------------------------------------------------------------------

    def _become(self, active: bool) -> None:
        if active and not self.active and self.law is not None:
            self.law.reset()
        super()._become(active)

    def _reset(self) -> None:
        if self.law is not None:
            self.law.reset()
        self.cross_fade()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._sign.reset()
        self._reset()
        response.success, response.message = True, 'the correction restarts'
        return response

    # --- the model of the plant ------------------------------------------------------------------

    def _on_load_model(
        self, request: LoadModel.Request, response: LoadModel.Response
    ) -> LoadModel.Response:
        before = self._model
        try:
            self._model = requested_model(request, self.parameters.text('model_folder'))
            self._built({})
            if self._laws.shapes(self.parameters.values, 'plant.gain'):
                self._reshape(['plant.gain'])
            name = self._model.model.name
            response.success, response.message = True, f'takes the plant from {name} now'
        except PiezoError as error:
            self._model = before
            response.success, response.message = False, str(error)
        return response
