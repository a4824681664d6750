"""Excitation, decoupling and limits of several axes as nodes of one process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rclpy.node import Node
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import SequenceFilter
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.modelfile import is_modal, is_there
from piezo_hysteresis.nodes.excitation.excitation import Excitation
from piezo_hysteresis.nodes.links.coupled_node import Coupled, VoltageLink
from piezo_hysteresis.nodes.messages import measured_of, point_of
from piezo_hysteresis.ros.cdr_header import nanoseconds_of_head
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import wall_timer
from piezo_hysteresis.runtime.coupled_ticks import CoupledBook
from piezo_interfaces.msg import ActuatorState, Reference

# Period of the check who publishes the references [s].
LOOK = 0.1


def is_requested() -> bool:
    """Return whether the arguments, or a parameter file, give a model of several axes.

    A `model_file` that is for all nodes of the process may be one of one axis; one that cannot be
    read is an error, so that the loop of one axis does not run in place of that of several.
    """
    probe = Node('coupled', enable_rosout=False, start_parameter_services=False)
    given = probe._parameter_overrides.get('model_file')
    probe.destroy_node()
    if given is None:
        return False
    if not is_there(str(given.value)):
        raise ModelError(f'there is no model file {given.value}; give the path of one')
    return is_modal(str(given.value))


class CoupledControlLoop:
    """The loop of several axes but the actuators.

    One tick of all axes is one step of the laws: nothing is commanded before the references of all
    axes are there, and where one stays away, the voltages of all axes go to safety.
    """

    def __init__(
        self,
        new_excitation: Callable[[int], Excitation] = lambda axis: Excitation(
            wired=False, axis=axis
        ),
    ) -> None:
        self.coupled = Coupled()
        self._axes = range(self.coupled.axes)
        self.links = [VoltageLink(i + 1) for i in self._axes]
        self._loop = self.coupled.begin(self.links)
        self._book = CoupledBook(len(self.links))
        self._newest, self._running = -1, False
        self._states = [SequenceFilter() for _ in self._axes]
        self.excitations = [new_excitation(i + 1) for i in self._axes]
        self._references: list[Subscription | None] = [None for _ in self._axes]
        for i, excitation in enumerate(self.excitations):
            excitation.deliver_to(partial(self._take_reference, i))
            excitation.stop.add_done_callback(self._on_done)
            self.coupled.create_subscription(
                ActuatorState, topics.of_axis(topics.STATE, i + 1), partial(self._on_state, i),
                LOOP, raw=True,
            )  # fmt: skip
        self._look()
        wall_timer(self.coupled, LOOK, self._look)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The node of the laws, which decides when the process ends; links; excitations."""
        return self.coupled, *self.links, *self.excitations

    def _on_done(self, _: object) -> None:
        if all(each.stop.done() for each in self.excitations):
            self.coupled.exit_code = max(each.exit_code for each in self.excitations)
            self.coupled.stop.set_result(True)

    def _look(self) -> None:
        """Subscribe to the references only of axes whose excitation publishes none."""
        for i, excitation in enumerate(self.excitations):
            own, subscription = excitation.refers, self._references[i]
            self.links[i].idle_publishers = 0 if own else 1
            if not own and subscription is None:
                topic = topics.of_axis(topics.REFERENCE, i + 1)
                self._references[i] = self.coupled.create_subscription(
                    Reference, topic, partial(self._on_reference, i), LOOP, raw=True
                )
            elif own and subscription is not None:
                self.coupled.destroy_subscription(subscription)
                self._references[i] = None

    def _on_reference(self, axis: int, payload: bytes) -> None:
        if not self.excitations[axis].refers:
            self._take_reference(axis, *point_of(payload), payload)

    def _take_reference(
        self, axis: int, head: bytes, point: ReferencePoint, payload: bytes
    ) -> None:
        sample = point.sample
        link = self.links[axis]
        newest = link.intake.newest
        if not link.intake.take(sample) and sample != newest:
            return
        link.stamps.true_time(sample, nanoseconds_of_head(head))
        if sample < newest and sample <= self._book.done:
            self._restart(sample)
        if sample <= self._book.done:
            link.pass_on_again(sample)
            return
        self._book.add_reference(axis, point, head)
        self._advance()

    def _restart(self, sample: int) -> None:
        """Restart all axes, because the actuator has."""
        self.coupled.dropped += self._book.dropped
        self._book = CoupledBook(len(self.links))
        self._running = False
        self._loop.restart()
        for link in self.links:
            link.restart_at(sample)

    def _advance(self) -> None:
        tick = self._book.take()
        if tick is None or self.coupled.failed:
            return
        voltages = self._loop.voltages(tick)
        sample = tick.points[0].sample
        if not self._running:
            self._running = True
            for link, voltage, measured in zip(self.links, voltages, tick.measured, strict=True):
                if measured is not None:  # the actuator moves already
                    link.start_at(measured.voltage)
                elif sample > 0:
                    link.start_at(voltage)
        for link, head, voltage in zip(self.links, tick.tags, voltages, strict=True):
            link.take(head, sample, voltage)

    def _on_state(self, axis: int, payload: bytes) -> None:
        head, measured = measured_of(payload)
        if not self._states[axis].take(measured.sample):
            return
        self._book.add_measured(axis, measured)
        self._advance()
        self.excitations[axis].take_state(head, measured, payload)
        # The command is on its way: the checks are done while the actuator moves.
        self._loop.take_state(axis, measured)
        if measured.sample != self._newest:  # once a tick, of whichever axis it comes
            self._newest = measured.sample
            for link in self.links:
                link.watch(head, measured.sample)
