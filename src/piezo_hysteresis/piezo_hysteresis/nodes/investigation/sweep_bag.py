"""The recorder of an experiment: a bag of the states and markers while a sweep runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.nodes.codecs import STATE as CODEC
from piezo_hysteresis.nodes.recording.offered_qos import offered_as_yaml
from piezo_hysteresis.nodes.recording.recorder_report import CONFIRM_AFTER, RecorderReport
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.timers import wall_timer
from piezo_interfaces.msg import ActuatorState, RecordMarker


class SweepBag:
    """Records one bag at a time; for the thread that spins its node.

    Parameters
    ----------
    node : Node
        Whose name the recorder has.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._report = RecorderReport(node)
        self._recorder: Recorder | None = None
        self._inlets: list[Subscription] = []
        self._newest = b''
        wall_timer(node, CONFIRM_AFTER, self._report.tell_news)

    @property
    def newest(self) -> tuple[int, float] | None:
        """Tick and voltage [V] of the last state that came, None where none ever did."""
        if not self._newest:
            return None
        _, (sample, voltage, _) = CODEC.decode(self._newest)
        return sample, voltage

    def begin(self, bag: Path) -> None:
        """Begin a new bag."""
        recorder = self._recorder = Recorder(bag)
        kinds: tuple[tuple[str, str, Any, Callable[[bytes, bool], None]], ...] = (
            (topics.STATE, STATE, ActuatorState, self._on_state),
            (topics.MARKER, MARKER, RecordMarker, self._report.on_marker),
        )
        self._report.begin(recorder)
        for short, kind, message, count in kinds:
            definition, type_hash = definition_of(kind)
            name = self._node.resolve_topic_name(short)
            number = recorder.add_topic(
                name, kind, definition=definition, type_hash=type_hash, qos=offered_as_yaml(LOOP)
            )
            keep = partial(_kept, recorder, number, count)
            self._inlets.append(
                self._node.create_subscription(message, short, keep, LOOP, raw=True)
            )

    def _on_state(self, payload: bytes, kept: bool) -> None:
        self._newest = payload
        self._report.on_state(payload, kept)

    def close(self) -> None:
        """Finish the bag, if there is one."""
        recorder, self._recorder = self._recorder, None
        for inlet in self._inlets:
            self._node.destroy_subscription(inlet)
        self._inlets.clear()
        self._report.end()
        if recorder is not None:
            recorder.close()


def _kept(
    recorder: Recorder, number: int, count: Callable[[bytes, bool], None], payload: bytes
) -> None:
    count(payload, recorder.write(number, payload, time.time_ns()))
