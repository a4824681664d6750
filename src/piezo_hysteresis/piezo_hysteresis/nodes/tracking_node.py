"""A link that compares the measurement with the reference: attenuation and feedback."""

from __future__ import annotations

from typing import Protocol

from std_msgs.msg import Header
from std_srvs.srv import Trigger

from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.crossfade import CrossFade
from piezo_hysteresis.nodes.link_node import Fade, LinkNode
from piezo_hysteresis.nodes.messages import measured_from, point_from
from piezo_hysteresis.nodes.tick_book import Tick, TickBook
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand
from piezo_ros_common import topics
from piezo_ros_common.order import started_anew
from piezo_ros_common.qos import LOOP
from piezo_ros_common.table import ParameterTable, Value


class Law(Protocol):
    """What such a link asks at every tick."""

    def step(self, point: ReferencePoint, received: float, measured: Measured | None) -> float:
        """Answer the voltage to pass on [V]."""

    def reset(self) -> None:
        """Forget everything but the settings."""

    def counters(self) -> dict[str, int]:
        """Return what happened so far, by name."""


class TrackingNode(LinkNode):
    """Brings reference, measurement and voltage of each tick together and asks a law.

    Subclasses say with `build` which law their parameters describe, and with `adjust` what they
    can change in the law that is there.
    """

    def __init__(self, name: str, table: ParameterTable) -> None:
        super().__init__(name, table, topics.VOLTAGE_COMMAND)
        try:
            self.law = self._ready(self.build({}))
        except PiezoError as error:
            self.give_up(str(error))
        self._book: TickBook[Header] = TickBook()
        self._begun = False
        self.create_subscription(Reference, topics.REFERENCE, self._on_reference, LOOP)
        self.create_subscription(ActuatorState, topics.STATE, self._on_state, LOOP)
        self.create_subscription(
            VoltageCommand, topics.VOLTAGE_FEEDFORWARD, self._on_voltage, LOOP
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.autostart()

    def new_fade(self) -> Fade:
        """Return what carries the share over a change: a new law begins without weight."""
        return CrossFade(self.dt, self.parameters.number('transition'))

    def build(self, changes: dict[str, Value]) -> Law | None:
        """Return the law that the parameters, with `changes`, describe; None for none.

        Raises
        ------
        PiezoError
            If they describe none that is possible.
        """
        raise NotImplementedError

    def adjust(self, changes: dict[str, Value]) -> bool:
        """Change the law that is there; return False where it takes a new one."""
        return False

    def shapes(self, name: str) -> bool:
        """Tell whether the parameter `name` shapes the law at all."""
        raise NotImplementedError

    def counters(self) -> dict[str, int]:
        """Return the counters of the law."""
        return {} if self.law is None else self.law.counters()

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return '' or why there is no such law."""
        try:
            if hasattr(self, 'parameters'):
                self.build(changes)
        except PiezoError as error:
            return str(error)
        return ''

    def apply(self, changes: dict[str, Value]) -> None:
        """Take changed parameters over; a new law begins without a correction."""
        super().apply(changes)
        own = {name: value for name, value in changes.items() if self.shapes(name)}
        if own and not self.adjust(own):
            self.law = self._ready(self.build({}))
            self.go_over()

    @staticmethod
    def _ready(law: Law | None) -> Law | None:
        """Compile the kernels of `law` before it gets its first tick."""
        if law is not None:
            for k in range(3):
                point = ReferencePoint(k, 0.0, 0.0, 0.0, 1.0, 0.0)
                law.step(point, 0.0, Measured(k - 1, 0.0, 1e-9 * k))
            law.reset()
        return law

    # --- ticks ---------------------------------------------------------------------------------

    def _on_reference(self, message: Reference) -> None:
        if started_anew(message.sample, self._book.done):
            self._book = TickBook()
            self._forget()
        self._book.add_reference(point_from(message))
        self._advance()

    def _on_state(self, message: ActuatorState) -> None:
        self._book.add_measured(measured_from(message))
        self._advance()

    def _on_voltage(self, message: VoltageCommand) -> None:
        if message.sample <= self._book.done:
            self.pass_on_again(message.sample)
            return
        self._book.add_voltage(message.sample, message.voltage, message.header)
        self._advance()

    def _advance(self) -> None:
        while (tick := self._book.take()) is not None:
            if not self._begun:
                self._begun = True
                self._join(tick)
            voltage = tick.received
            if self.active and self.law is not None:
                voltage = self.law.step(tick.point, tick.received, tick.measured)
            self.pass_on(tick.tag, tick.point.sample, tick.received, voltage)
            self.passed(tick)

    def passed(self, tick: Tick[Header]) -> None:
        """Do what is to be done once a tick has been passed on."""

    def _join(self, tick: Tick[Header]) -> None:
        """Start from the voltage that is there where the loop is under way already."""
        if tick.measured is not None:
            self.start_at(tick.measured.voltage)
        elif tick.point.sample > 0:
            self.start_at(tick.received)

    # --- forgetting ----------------------------------------------------------------------------

    def _become(self, active: bool) -> None:
        if active and not self.active and hasattr(self, 'law') and self.law is not None:
            self.law.reset()
        super()._become(active)

    def _forget(self) -> None:
        if self.law is not None:
            self.law.reset()
        self.go_over()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._forget()
        response.success, response.message = True, 'the correction starts anew'
        return response
