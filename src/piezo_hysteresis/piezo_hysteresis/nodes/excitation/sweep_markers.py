"""Publishes sweep markers and checks that all subscribers are matched."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from rclpy.node import Node
from rclpy.publisher import Publisher

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import nanoseconds_of, stamp_into
from piezo_hysteresis.nodes.recording.reports import QUIET, Reports
from piezo_hysteresis.records.markers import sample_text
from piezo_hysteresis.ros.diagnostics import TOPIC as DIAGNOSTICS
from piezo_hysteresis.ros.neighbours import Neighbours
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.consumer_progress import Progress
from piezo_hysteresis.runtime.sweep_plan import SweepRecord
from piezo_interfaces.msg import RecordMarker

# Nodes that come and go all the time hold a sweep up no longer than this [s].
LONGEST_QUIET = 4.0


def missing_subscribers(publisher: Publisher, topic: str, count: int) -> str:
    """Return how many subscribers a topic wants and has; empty where they are all there."""
    there = publisher.get_subscription_count()
    return '' if there >= count else f'{count} subscribers of {topic}, {there} are there'


class SweepAudience:
    """The nodes that take the markers of a sweep in.

    Parameters
    ----------
    node : Node
        That runs the sweep.
    parameters : NodeParameters
        Of the node: ``rate``, ``actuator``, ``marker_listeners``.
    neighbours : Neighbours
        Who of them starts or compiles.
    edge_at : callable
        Returns the time at which a tick begins for readers of the actuator states [ns].
    received : callable
        Called when one of them has reported how far it is.
    """

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        neighbours: Neighbours,
        edge_at: Callable[[int], int],
        received: Callable[[], None],
    ) -> None:
        self._parameters, self._neighbours = parameters, neighbours
        self.edge_at = edge_at
        self._publisher = node.create_publisher(RecordMarker, topics.MARKER, LOOP)
        self._reports = Reports(node, topics.MARKER, received)

    def look(self) -> None:
        """Notice who has come and who has gone."""
        self._reports.look()

    def keepers(self) -> Mapping[str, Progress]:
        """Return what the recorders have reported, by name."""
        return self._reports.keepers()

    def missing(self, asked: float) -> str:
        """Return who has to be there before the first tick; empty where all are.

        Parameters
        ----------
        asked : float
            When the sweep was asked for [s], on the monotonic clock.
        """
        reports = self._reports
        count = max(self._parameters.integer('marker_listeners'), reports.subscribed)
        if missing := missing_subscribers(self._publisher, topics.MARKER, count):
            return missing
        if silent := reports.silent():
            return f'the first word of {", ".join(silent)} on its status'
        if starting := self._starting():
            return starting
        now = time.monotonic()
        calm = now - max(asked, reports.quiet_since()) >= QUIET
        return '' if calm or now - asked > LONGEST_QUIET else 'nodes that are just starting'

    def _starting(self) -> str:
        """Return who of the others is not there as a whole yet; empty for nobody."""
        self._neighbours.look()
        if awaiting_first_heartbeat := self._neighbours.awaiting_first_heartbeat():
            return f'the first word of {", ".join(awaiting_first_heartbeat)} on {DIAGNOSTICS}'
        return self._neighbours.working()

    def mark(self, record: SweepRecord, sample: int) -> int:
        """Say that a record begins at tick `sample`; return the stamp of the marker [ns]."""
        info = record.info
        marker = RecordMarker(record=record.name, excitation=info.excitation)
        marker.actuator = self._parameters.text('actuator')
        marker.frequency = info.frequency
        marker.amplitude = info.amplitude
        marker.warm_up = info.warm_up
        marker.input_unit = info.input_unit
        return self._say(marker, sample)

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Say that a record ends at tick `sample`, or that `judged` does not count and why."""
        marker = RecordMarker(excitation=verdict)
        marker.header.frame_id = judged
        return self._say(marker, sample)

    def _say(self, marker: RecordMarker, sample: int) -> int:
        marker.rate = self._parameters.number('rate')
        marker.header.frame_id = marker.header.frame_id or sample_text(sample)
        stamp_into(marker.header.stamp, self.edge_at(sample))
        self._publisher.publish(marker)
        return nanoseconds_of(marker.header.stamp)
