"""Attenuates harmonics of the tracking error: Fujii 2018 (18)-(21) or adaptive cancellation."""

from __future__ import annotations

import sys

from piezo_hysteresis.common import topics
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
from piezo_hysteresis.nodes.links.tracking_node import TrackingNode
from piezo_hysteresis.parameters.links import ATTENUATION
from piezo_hysteresis.ros.cdr_header import stamp_of
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import run_node
from piezo_hysteresis.runtime.laws import HarmonicLaws
from piezo_hysteresis.runtime.synchronizer import Tick
from piezo_interfaces.msg import HarmonicState

# Ticks between two reports of the harmonics.
REPORT_EVERY = 100


class HarmonicReport:
    """Publishes periodically the harmonics that the attenuation of a node estimates."""

    def __init__(self, node: TrackingNode) -> None:
        self._node = node
        self._message = HarmonicState()
        self._publisher = node.plain_publisher(HarmonicState, topics.HARMONICS, LOOP)

    def __call__(self, tick: Tick[bytes]) -> None:
        """Report after this tick, if it is time."""
        law = self._node.law
        if tick.point.sample % REPORT_EVERY or not isinstance(law, HarmonicAttenuation):
            return
        message = self._message
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(tick.tag)
        message.sample = tick.point.sample
        message.frequency = tick.point.frequency
        found = law.harmonics()
        message.orders = [each.order for each in found]
        message.error_amplitudes = [each.error_amplitude for each in found]
        message.error_phases = [each.error_phase for each in found]
        message.correction_amplitudes = [each.correction_amplitude for each in found]
        message.correction_phases = [each.correction_phase for each in found]
        self._publisher.publish(message)


def attenuation(*, output: str = topics.VOLTAGE_COMMAND, wired: bool = True) -> TrackingNode:
    """Return the second link of the chain, which attenuates harmonics of the tracking error."""
    return TrackingNode(
        'attenuation', ATTENUATION, HarmonicLaws(), HarmonicReport, output=output, wired=wired
    )


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(attenuation))
