"""Publishes on ``~/status`` the counters of a recorder."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from piezo_hysteresis.common.stamps import nanoseconds_of
from piezo_hysteresis.nodes.codecs import STATE
from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.ros.qos import LATCHED
from piezo_hysteresis.runtime.consumer_progress import Taken
from piezo_interfaces.msg import LoopStatus, RecordMarker

# Samples between two confirmations, and the longest time to the next one [s].
CONFIRM_EVERY = 64
CONFIRM_AFTER = 0.05

# What is confirmed is in the bag: for so long after a marker it is written at once, and so long it
# is waited for that [s].
CONFIRM_WITHIN, FLUSHED_WITHIN = 0.2, 0.1


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
        self._recorder: Recorder | None = None
        self._queued: deque[tuple[int, Taken]] = deque()
        self._stored = Taken()
        self._marked = 0.0
        self._reported: list[int] = []
        # who drives an experiment waits for the first word of everybody who may record it
        self._publisher.publish(LoopStatus())

    def begin(self, recorder: Recorder, confirms: bool = True) -> None:
        """Say that a recording begins; it `confirms` where it takes both states and markers."""
        self._recorder, self._taken = recorder, Taken() if confirms else None
        self._queued.clear()
        self._stored, self._marked = Taken(), 0.0
        self.tell()

    def end(self) -> None:
        """Say that nothing is recorded any more."""
        self._recorder, self._taken, self._reported = None, None, []
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
        """Count a marker, and confirm it as soon as it is in the bag."""
        if self._taken is None:
            return
        marker = deserialize_message(payload, RecordMarker)
        self._taken.marker(nanoseconds_of(marker.header.stamp), kept)
        self._marked = time.monotonic()
        self.tell()

    def tell_news(self) -> None:
        """Publish if the counts have changed since they were last published."""
        if self._taken is not None and (
            self._queued or list(self._taken.counts().values()) != self._reported
        ):
            self.tell()

    def tell(self) -> None:
        """Publish how far the recorder is: what it has taken, and what of it is in the bag."""
        if self._recorder is None:
            return
        status = self._recorder.status
        if self._taken is not None:
            self._queued.append((status.received - status.dropped, replace(self._taken)))
            if time.monotonic() - self._marked < CONFIRM_WITHIN:
                self._recorder.flush(timeout=FLUSHED_WITHIN)
                status = self._recorder.status
        while self._queued and self._queued[0][0] <= status.written:
            self._stored = self._queued.popleft()[1]
        counts = {
            'received': status.received,
            'written': status.written,
            'dropped': status.dropped,
        }
        if self._taken is not None:
            taken = self._taken
            counts |= replace(self._stored, taken=taken.taken, marked=taken.marked).counts()
            self._reported = list(taken.counts().values())
        message = LoopStatus(sample=status.written, missed=status.dropped)
        message.names, message.counts = list(counts), list(counts.values())
        self._publisher.publish(message)
