"""Attenuates harmonics of the tracking error: Fujii 2018 (18)-(21) or adaptive cancellation."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import Any

from piezo_common import topics
from piezo_common.table import Value
from piezo_hysteresis.compensation.harmonics.attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.nodes.links.tracking_node import Law, TrackingNode
from piezo_hysteresis.parameters.links import ATTENUATION
from piezo_hysteresis.runtime.synchronizer import Tick
from piezo_interfaces.msg import HarmonicState
from piezo_ros_common.flat import stamp_of
from piezo_ros_common.qos import LOOP
from piezo_ros_common.running import run_node

# The settings of the law are parameters under the same names.
_SETTINGS = tuple(field.name for field in fields(AttenuationSettings))

# Ticks between two reports of the harmonics.
REPORT_EVERY = 100


class Attenuation(TrackingNode):
    """The second link of the chain: takes harmonics of the tracking error off."""

    def __init__(self, *, output: str = topics.VOLTAGE_COMMAND, wired: bool = True) -> None:
        self._harmonics = HarmonicState()
        super().__init__('attenuation', ATTENUATION, output=output, wired=wired)
        self._harmonics_publisher = self.plain_publisher(HarmonicState, topics.HARMONICS, LOOP)

    def build(self, changes: dict[str, Value]) -> Law | None:
        """Return the law with the settings of the parameters; None where it is not enabled."""
        values: dict[str, Any] = {**self.parameters.values, **changes}
        settings = {name: values[name] for name in _SETTINGS}
        settings['orders'] = tuple(settings['orders'])
        law = HarmonicAttenuation(AttenuationSettings(**settings), _gain(values), self.dt)
        return law if values['enabled'] else None

    def shapes(self, name: str) -> bool:
        """Return whether `name` is a setting of the law."""
        return name in _SETTINGS or name == 'enabled' or name.startswith('plant.')

    def adjust(self, changes: dict[str, Value]) -> bool:
        """Take a new model of the plant gain without forgetting the correction."""
        if not all(name.startswith('plant.') for name in changes):
            return False
        if isinstance(self.law, HarmonicAttenuation):
            self.law.set_gain(_gain(self.parameters.values))
        return True

    def passed(self, tick: Tick[bytes]) -> None:
        """Report the harmonics now and then."""
        if tick.point.sample % REPORT_EVERY or not isinstance(self.law, HarmonicAttenuation):
            return
        message = self._harmonics
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(tick.tag)
        message.sample = tick.point.sample
        message.frequency = tick.point.frequency
        found = self.law.harmonics()
        message.orders = [each.order for each in found]
        message.error_amplitudes = [each.error_amplitude for each in found]
        message.error_phases = [each.error_phase for each in found]
        message.correction_amplitudes = [each.correction_amplitude for each in found]
        message.correction_phases = [each.correction_phase for each in found]
        self._harmonics_publisher.publish(message)


def _gain(values: dict[str, Any]) -> ModeGain:
    return ModeGain(
        values['plant.gain'],
        values['plant.natural_frequency'],
        values['plant.damping_ratio'],
        1.0 / values['rate'],
    )


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Attenuation))
