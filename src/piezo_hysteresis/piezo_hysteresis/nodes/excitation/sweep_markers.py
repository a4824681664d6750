"""Publishes the markers of a sweep, and records it if a bag is requested."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.stamps import stamp_into
from piezo_hysteresis.nodes.recording.listeners import offered_as_yaml, subscribers
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of
from piezo_hysteresis.records.markers import sample_text
from piezo_hysteresis.records.recorder import Recorder, RecorderStatus
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.sweep_plan import SweepRecord
from piezo_interfaces.msg import RecordMarker


def missing_subscribers(publisher: Publisher, topic: str, count: int) -> str:
    """Return required and present subscribers of a topic; empty if all are present."""
    there = publisher.get_subscription_count()
    return '' if there >= count else f'{count} subscribers of {topic}, {there} are there'


def undiscovered(node: Node, publisher: Publisher, topic: str, least: int) -> str:
    """Return the missing ones of at least `least` subscribers and of all in the graph."""
    count = max(least, subscribers(node, publisher.topic_name))
    return missing_subscribers(publisher, topic, count)


class SweepMarkers:
    """The markers of a sweep, and the bag of its states and markers."""

    def __init__(
        self, node: Node, parameters: NodeParameters, edge_at: Callable[[int], int]
    ) -> None:  # edge_at [ns]
        self._node, self._parameters, self._edge_at = node, parameters, edge_at
        self._publisher = node.create_publisher(RecordMarker, topics.MARKER, LOOP)
        self._recorder: Recorder | None = None
        self._numbers: list[int] = []
        self._queued = 0

    def missing(self) -> str:
        """Return the missing subscribers before the first tick; empty if all are connected."""
        least = self._parameters.integer('marker_listeners')
        return undiscovered(self._node, self._publisher, topics.MARKER, least)

    def begin(self, bag: Path) -> None:
        """Start the recording."""
        recorder = Recorder(bag)
        self._numbers, self._queued = [], 0
        for short, kind in ((topics.STATE, STATE), (topics.MARKER, MARKER)):
            definition, type_hash = definition_of(kind)
            name, qos = self._node.resolve_topic_name(short), offered_as_yaml(LOOP)
            self._numbers.append(
                recorder.add_topic(name, kind, definition=definition, type_hash=type_hash, qos=qos)
            )
        self._recorder = recorder

    def state(self, payload: bytes) -> bool:
        """Record a state as received; return False if it had to be dropped."""
        return self._write(0, payload)

    def _write(self, topic: int, payload: bytes) -> bool:
        recorder = self._recorder
        if recorder is None:
            return True
        is_queued = recorder.write(self._numbers[topic], payload, time.time_ns())
        self._queued += is_queued
        return is_queued

    def close(self, *, empty: bool = False) -> RecorderStatus | None:
        """Finish the bag and return what is in it, if there is one; remove it if it is `empty`."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return None
        status = recorder.close()
        if empty:
            shutil.rmtree(recorder.path, ignore_errors=True)
        return status

    def mark(self, record: SweepRecord, sample: int) -> None:
        """Mark that a record begins at tick `sample`."""
        info = record.info
        marker = RecordMarker(record=record.name, excitation=info.excitation)
        marker.actuator = self._parameters.text('actuator')
        marker.frequency = info.frequency
        marker.amplitude = info.amplitude
        marker.warm_up = info.warm_up
        marker.input_unit = info.input_unit
        self._publish(marker, sample)

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Mark the end of a record at tick `sample`, or reject the record with a reason.

        Return the number of messages that the recording has accepted so far.
        """
        marker = RecordMarker(excitation=verdict)
        marker.header.frame_id = judged
        self._publish(marker, sample)
        return self._queued

    def _publish(self, marker: RecordMarker, sample: int) -> None:
        marker.rate = self._parameters.number('rate')
        marker.header.frame_id = marker.header.frame_id or sample_text(sample)
        stamp_into(marker.header.stamp, self._edge_at(sample))
        payload = serialize_message(marker)
        self._write(1, payload)
        self._publisher.publish(payload)
