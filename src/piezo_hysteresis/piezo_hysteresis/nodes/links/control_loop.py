"""Excitation, feedforward, attenuation, feedback and a recorder as nodes of one process."""

from __future__ import annotations

import sys
from collections.abc import Callable

from rclpy.node import Node
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.nodes.excitation.excitation import Excitation
from piezo_hysteresis.nodes.links.attenuation_node import attenuation
from piezo_hysteresis.nodes.links.coupled_loop import CoupledControlLoop, is_requested
from piezo_hysteresis.nodes.links.feedback_node import feedback
from piezo_hysteresis.nodes.links.feedforward_node import Feedforward
from piezo_hysteresis.nodes.messages import measured_of, point_of
from piezo_hysteresis.nodes.recording import recorder_node
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import run_nodes, wall_timer
from piezo_interfaces.msg import ActuatorState, Reference

# Period of the check who publishes the reference [s].
LOOK = 0.1


class ControlLoop:
    """Everything but the actuator, with the nodes, parameters and topics of separate processes.

    Each node passes reference and voltage to the next one by a call, before they are published.
    The state is received once for all. Feedback forwards the voltage until its `method` is set.
    A reference of another process is followed while the excitation publishes none. The recorder
    is there if it is given a bag, `-p recorder:out:=FOLDER`.
    """

    def __init__(
        self, new_excitation: Callable[[], Excitation] = lambda: Excitation(wired=False)
    ) -> None:
        self.feedforward = Feedforward(wired=False)
        self.attenuation = attenuation(output=topics.VOLTAGE_ATTENUATED, wired=False)
        self.feedback = feedback(wired=False)
        self.links = self.feedforward, self.attenuation, self.feedback
        self.recorder = None
        if recorder_node.is_requested():
            self.recorder = recorder_node.create(wired=False)
        self.attenuation.deliver_to(self.feedback.take_voltage)
        self.feedforward.deliver_to(self.attenuation.take_voltage)
        self.excitation = new_excitation()
        self.excitation.deliver_to(self._take_reference)
        self._references: Subscription | None = None
        self._look()
        wall_timer(self.feedforward, LOOK, self._look)
        self.feedforward.create_subscription(
            ActuatorState, topics.STATE, self._on_state, LOOP, raw=True
        )

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The excitation, which decides when the process ends; the links; the recorder."""
        recorder = () if self.recorder is None else (self.recorder,)
        return self.excitation, *self.links, *recorder

    def _look(self) -> None:
        """Subscribe to the reference only if another process may publish it."""
        own = self.excitation.refers
        self.feedforward.idle_publishers = 0 if own else 1
        if not own and self._references is None:
            self._references = self.feedforward.create_subscription(
                Reference, topics.REFERENCE, self._on_reference, LOOP, raw=True
            )
        elif own and self._references is not None:
            self.feedforward.destroy_subscription(self._references)
            self._references = None

    def _on_reference(self, payload: bytes) -> None:
        if not self.excitation.refers:
            self._take_reference(*point_of(payload), payload)

    def _take_reference(self, head: bytes, point: ReferencePoint, payload: bytes) -> None:
        # The first link responds immediately, so the others need the reference before.
        for link in reversed(self.links):
            link.take_reference(head, point)
        if self.recorder is not None:
            self.recorder.take(topics.REFERENCE, payload)

    def _on_state(self, payload: bytes) -> None:
        head, measured = measured_of(payload)
        due = [link for link in (self.feedback, self.attenuation) if link.take_measured(measured)]
        if self.recorder is not None:
            self.recorder.take(topics.STATE, payload)
        self.excitation.take_state(head, measured, payload)
        # The command is on its way: the checks are done while the actuator moves.
        for link in due:
            link.check_state(head, measured)
        self.feedforward.take_state(head, measured)


def create() -> tuple[Node, ...]:
    """Return the nodes of one axis, or of several where a model of several is given."""
    return (CoupledControlLoop() if is_requested() else ControlLoop()).nodes


def main() -> None:
    """Run the nodes as one process."""
    sys.exit(run_nodes(create))
