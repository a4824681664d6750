"""A client that sends invalid messages into the loop: not finite, repeated, reordered, old.

Used by `bench/faults.py`.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable
from typing import Any

from bench.live_observer import ROGUE, Observer
from piezo_hysteresis.common import topics
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand

Spoilt = ActuatorState | Reference | VoltageCommand

# Where the rogue talks, and the field that carries the value.
TARGETS: dict[str, tuple[type[Spoilt], str]] = {
    topics.STATE: (ActuatorState, 'displacement'),
    topics.REFERENCE: (Reference, 'displacement'),
    topics.VOLTAGE_FEEDFORWARD: (VoltageCommand, 'voltage'),
    topics.VOLTAGE_COMMAND: (VoltageCommand, 'voltage'),
}

# A value that is allowed, and far from the genuine one [V], [m].
SPIKES = {'voltage': 0.9, 'displacement': 1.2e-4}


def _valued(value: float) -> Callable[[Spoilt, str], None]:
    def spoil(message: Spoilt, field: str) -> None:
        message.sample += 1
        setattr(message, field, value)

    return spoil


def _spike(message: Spoilt, field: str) -> None:
    message.sample += 1
    setattr(message, field, SPIKES[field])


def _numbered(step: int) -> Callable[[Spoilt, str], None]:
    def spoil(message: Spoilt, _: str) -> None:
        message.sample = max(0, message.sample + step)

    return spoil


def _first(message: Spoilt, _: str) -> None:
    message.sample = 0


def _late_stamp(message: Spoilt, _: str) -> None:
    message.sample += 1
    message.header.stamp.sec += 3600


# What is done to a copy of the newest genuine message. Values are spoilt for the next tick, so
# that the rogue is there before the genuine message of that tick is.
FAULTS: dict[str, Callable[[Spoilt, str], None]] = {
    'nan': _valued(math.nan),
    'infinite': _valued(math.inf),
    'huge': _valued(1e6),
    'spike': _spike,
    'doubled': _numbered(0),
    'reordered': _numbered(-5),
    'stale': _numbered(-500),
    'ahead': _numbered(10**6),
    'from_zero': _first,
    'stamp_jump': _late_stamp,
}


class Rogue:
    """Publishes corrupted copies of the messages of an observer."""

    def __init__(self, observer: Observer) -> None:
        self._left: dict[str, tuple[str, int]] = {}
        self._publishers: dict[str, Any] = {}
        for topic, (kind, _) in TARGETS.items():
            self._publishers[topic] = observer.node.create_publisher(kind, topic, LOOP)
            observer.hooks[topic] = functools.partial(self._answer, topic)

    def _answer(self, topic: str, message: Spoilt) -> None:
        fault, left = self._left.get(topic, ('', 0))
        if left > 0:
            spoilt = copy.deepcopy(message)
            spoilt.header.frame_id = ROGUE
            FAULTS[fault](spoilt, TARGETS[topic][1])
            self._publishers[topic].publish(spoilt)
            self._left[topic] = (fault, left - 1)

    def talk(self, topic: str, fault: str, messages: int) -> None:
        """Spoil the next so many messages of `topic` by `fault`."""
        self._left[topic] = (fault, messages)

    def silent(self, topic: str) -> bool:
        """Return whether all messages have been published."""
        return self._left.get(topic, ('', 0))[1] <= 0
