"""Codecs of the per-tick messages, between bytes and the objects of the core."""

from __future__ import annotations

from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.ros.flat import FlatCodec
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand

REFERENCE = FlatCodec(Reference)
STATE = FlatCodec(ActuatorState)
VOLTAGE = FlatCodec(VoltageCommand)


def point_of(payload: bytes) -> tuple[bytes, ReferencePoint]:
    """Return the head and the point of a Reference."""
    head, numbers = REFERENCE.decode(payload)
    return head, ReferencePoint._make(numbers)


def reference_bytes(head: bytes, point: ReferencePoint) -> bytes:
    """Return a Reference."""
    return head + REFERENCE.pack(*point)


def measured_of(payload: bytes) -> tuple[bytes, Measured]:
    """Return the head and the measurement of an ActuatorState."""
    head, numbers = STATE.decode(payload)
    return head, Measured._make(numbers)


def voltage_bytes(head: bytes, sample: int, voltage: float) -> bytes:
    """Return a VoltageCommand."""
    return head + VOLTAGE.pack(sample, voltage)
