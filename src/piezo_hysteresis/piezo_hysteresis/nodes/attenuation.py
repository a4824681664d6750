"""Attenuates harmonics of the tracking error: 000 (18)-(21) or adaptive cancellation."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from std_msgs.msg import Header

from piezo_hysteresis.compensation.attenuation import AttenuationSettings, HarmonicAttenuation
from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.link_node import LinkNode
from piezo_hysteresis.nodes.messages import measured_from, point_from
from piezo_hysteresis.nodes.tables import ATTENUATION
from piezo_hysteresis.nodes.tick_book import Tick, TickBook
from piezo_interfaces.msg import ActuatorState, HarmonicState, Reference, VoltageCommand
from piezo_ros_common import topics
from piezo_ros_common.qos import LOOP
from piezo_ros_common.running import run_node
from piezo_ros_common.table import Value

# Parameters that make up the settings of the law, under the same names.
_LAW = ('method', 'orders', 'sign_rule', 'gain')

# Ticks between two reports of the harmonics.
REPORT_EVERY = 100


class Attenuation(LinkNode):
    """The second link of the chain: takes harmonics of the tracking error off."""

    def __init__(self) -> None:
        super().__init__('attenuation', ATTENUATION, topics.VOLTAGE_COMMAND)
        self._law = self._new_law()
        self._book: TickBook[Header] = TickBook()
        self._harmonics = HarmonicState()
        self._harmonics_publisher = self.create_publisher(HarmonicState, topics.HARMONICS, LOOP)
        self.create_subscription(Reference, topics.REFERENCE, self._on_reference, LOOP)
        self.create_subscription(ActuatorState, topics.STATE, self._on_state, LOOP)
        self.create_subscription(
            VoltageCommand, topics.VOLTAGE_FEEDFORWARD, self._on_voltage, LOOP
        )
        self.autostart()

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return '' or why the settings are impossible."""
        try:
            self._settings(changes)
        except PiezoError as error:
            return str(error)
        return ''

    def apply(self, changes: dict[str, Value]) -> None:
        """Take changed settings over; the new law starts without a correction."""
        super().apply(changes)
        if any(name.startswith('plant.') for name in changes):
            self._law.set_gain(self._plant_gain())
        if not changes.keys().isdisjoint(_LAW):
            self._law = self._new_law()

    def _new_law(self) -> HarmonicAttenuation:
        """Return a fresh law whose kernels are compiled before it gets its first tick."""
        law = HarmonicAttenuation(self._settings({}), self._plant_gain(), self.dt)
        for k in range(3):
            law.step(
                ReferencePoint(k, 0.0, 0.0, 0.0, 1.0, 0.0), 0.0, Measured(k - 1, 0.0, 1e-9 * k)
            )
        law.reset()
        return law

    def counters(self) -> dict[str, int]:
        """Return the counters of the law."""
        return self._law.counters()

    def _settings(self, changes: Mapping[str, Value]) -> AttenuationSettings:
        known = self.parameters.values if hasattr(self, 'parameters') else {}
        merged: dict[str, Any] = {name: changes.get(name, known.get(name)) for name in _LAW}
        merged['orders'] = tuple(merged['orders'])
        return AttenuationSettings(**merged)

    def _plant_gain(self) -> ModeGain:
        value = self.parameters.number
        return ModeGain(
            value('plant.gain'),
            value('plant.natural_frequency'),
            value('plant.damping_ratio'),
            self.dt,
        )

    def _on_reference(self, message: Reference) -> None:
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
            voltage = tick.received
            if self.active and self.parameters.flag('enabled'):
                voltage = self._law.step(tick.point, tick.received, tick.measured)
            self.pass_on(tick.tag, tick.point.sample, voltage)
            if tick.point.sample % REPORT_EVERY == 0:
                self._report(tick)

    def _report(self, tick: Tick[Header]) -> None:
        message = self._harmonics
        message.header = tick.tag
        message.sample = tick.point.sample
        message.frequency = tick.point.frequency
        found = self._law.harmonics()
        message.orders = [each.order for each in found]
        message.error_amplitudes = [each.error_amplitude for each in found]
        message.error_phases = [each.error_phase for each in found]
        message.correction_amplitudes = [each.correction_amplitude for each in found]
        message.correction_phases = [each.correction_phase for each in found]
        self._harmonics_publisher.publish(message)


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Attenuation))
