"""Tells on ``~/status`` what a recorder has taken, for whoever drives an experiment."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from piezo_common.stamps import nanoseconds_of
from piezo_hysteresis.nodes.codecs import STATE
from piezo_hysteresis.records.recorder import RecorderStatus
from piezo_hysteresis.runtime.confirmation import Taken
from piezo_interfaces.msg import LoopStatus, RecordMarker
from piezo_ros_common.qos import LATCHED

# Samples between two confirmations, and the longest time to the next one [s].
CONFIRM_EVERY = 64
CONFIRM_AFTER = 0.05


class RecorderReport:
    """Counts what goes into a recorder, and publishes it.

    Parameters
    ----------
    node : Node
        That records.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(LoopStatus, '~/status', LATCHED)
        self._taken: Taken | None = None
        self._ask: Callable[[], RecorderStatus] = lambda: RecorderStatus(0, 0, 0, '')
        self._reported: list[int] = []
        # who drives an experiment waits for the first word of everybody who may record it
        self._publisher.publish(LoopStatus())

    def begin(self, ask: Callable[[], RecorderStatus], confirms: bool = True) -> None:
        """Say that a recording begins; it `confirms` where it takes both states and markers."""
        self._ask, self._taken = ask, Taken() if confirms else None
        self.tell()

    def end(self) -> None:
        """Say that nothing is recorded any more."""
        self._taken, self._reported = None, []
        self._publisher.publish(LoopStatus())

    def on_state(self, payload: bytes, kept: bool) -> None:
        """Count a state that the recorder was handed, and kept unless it had no room."""
        if self._taken is None:
            return
        _, (sample, _, _) = STATE.decode(payload)
        self._taken.state(sample, kept)
        if self._taken.taken % CONFIRM_EVERY == 0:
            self.tell()

    def on_marker(self, payload: bytes, kept: bool) -> None:
        """Count a marker, and confirm it at once."""
        if self._taken is None:
            return
        marker = deserialize_message(payload, RecordMarker)
        self._taken.marker(nanoseconds_of(marker.header.stamp), kept)
        self.tell()

    def tell_news(self) -> None:
        """Publish where something was taken since the last word."""
        if self._taken is not None and list(self._taken.counts().values()) != self._reported:
            self.tell()

    def tell(self) -> None:
        """Publish how far the recorder is."""
        status = self._ask()
        counts = {
            'received': status.received,
            'written': status.written,
            'dropped': status.dropped,
        }
        taken = {} if self._taken is None else self._taken.counts()
        self._reported = list(taken.values())
        counts |= taken
        message = LoopStatus(sample=status.written, missed=status.dropped)
        message.names, message.counts = list(counts), list(counts.values())
        self._publisher.publish(message)
