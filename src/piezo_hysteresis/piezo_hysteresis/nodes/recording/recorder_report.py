"""Publishes on ``~/status`` the counters of a recorder."""

from __future__ import annotations

from rclpy.node import Node

from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.ros.qos import LATCHED
from piezo_hysteresis.runtime.consumer_progress import MARKED, TAKEN
from piezo_interfaces.msg import LoopStatus

# Samples between two reports, and the longest time to the next one [s]: a player waits for them.
REPORT_EVERY, REPORT_AFTER = 64, 0.05


class RecorderReport:
    """Counts the recorded messages and publishes the counts."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(LoopStatus, '~/status', LATCHED)
        self._recorder: Recorder | None = None
        self._taken: dict[str, int] = {}
        self._reported: dict[str, int] = {}
        # a player waits for the first report of every consumer
        self._publisher.publish(LoopStatus())

    def begin(self, recorder: Recorder, counts: bool) -> None:
        """Start the reports; `counts` states whether it records states and markers."""
        self._recorder = recorder
        self._taken = {TAKEN: 0, MARKED: 0} if counts else {}
        self.publish_counts()

    def on_state(self) -> None:
        """Count a state."""
        self._taken[TAKEN] += 1
        if self._taken[TAKEN] % REPORT_EVERY == 0:
            self.publish_counts()

    def on_marker(self) -> None:
        """Count a marker."""
        self._taken[MARKED] += 1
        self.publish_counts()

    def publish_if_changed(self) -> None:
        """Publish if the counts have changed since they were last published."""
        if self._taken != self._reported:
            self.publish_counts()

    def publish_counts(self) -> None:
        """Publish the numbers of received and of stored messages."""
        if self._recorder is None:
            return
        status = self._recorder.status
        self._reported = dict(self._taken)
        counts = {
            'received': status.received,
            'written': status.written,
            'dropped': status.dropped,
            **self._taken,
        }
        message = LoopStatus(sample=status.written, missed=status.dropped)
        message.names, message.counts = list(counts), list(counts.values())
        self._publisher.publish(message)
