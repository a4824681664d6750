"""Feedforward, attenuation and feedback as nodes of one process, intra-process."""

from __future__ import annotations

import sys

from rclpy.node import Node

from piezo_hysteresis.common import topics
from piezo_hysteresis.nodes.codecs import measured_of, point_of
from piezo_hysteresis.nodes.links.attenuation_node import attenuation
from piezo_hysteresis.nodes.links.feedback_node import feedback
from piezo_hysteresis.nodes.links.feedforward_node import Feedforward
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import run_nodes
from piezo_interfaces.msg import ActuatorState, Reference


class ControlLoop:
    """The whole voltage chain, with the nodes, parameters and topics of separate processes.

    Each link passes the voltage to the next one by a call, before it is published. Reference and
    state are received once for all three. Feedback forwards the voltage until its `method` is set.
    """

    def __init__(self) -> None:
        self.feedback = feedback(wired=False)
        self.attenuation = attenuation(output=topics.VOLTAGE_ATTENUATED, wired=False)
        self.feedforward = Feedforward(wired=False)
        self.attenuation.deliver_to(self.feedback.take_voltage)
        self.feedforward.deliver_to(self.attenuation.take_voltage)
        for kind, topic, take in (
            (ActuatorState, topics.STATE, self._on_state),
            (Reference, topics.REFERENCE, self._on_reference),
        ):
            self.feedforward.create_subscription(kind, topic, take, LOOP, raw=True)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The links, first to last."""
        return self.feedforward, self.attenuation, self.feedback

    def _on_reference(self, payload: bytes) -> None:
        head, point = point_of(payload)
        # The first link responds immediately, so the others need the reference before.
        for link in (self.feedback, self.attenuation, self.feedforward):
            link.take_reference(head, point)

    def _on_state(self, payload: bytes) -> None:
        head, measured = measured_of(payload)
        for link in (self.feedback, self.attenuation, self.feedforward):
            link.take_state(head, measured)


def main() -> None:
    """Run the nodes as one process."""
    sys.exit(run_nodes(lambda: ControlLoop().nodes))
