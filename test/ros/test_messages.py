"""Conversions between messages and the objects of the core keep every number."""

from __future__ import annotations

import math
import struct

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from piezo_hysteresis.common.stamps import nanoseconds_of, stamp_into, tick_nanoseconds
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification.online import online
from piezo_hysteresis.identification.rls_ud import OnlineBank, OnlineUd, UdSettings
from piezo_hysteresis.models import named
from piezo_hysteresis.nodes.messages import (
    estimate_into,
    measured_of,
    model_from,
    point_of,
    reference_bytes,
    voltage_bytes,
)
from piezo_hysteresis.ros.cdr_header import FlatCodec, head_of, stamp_of
from piezo_interfaces.msg import (
    ActuatorState,
    HarmonicState,
    ModelEstimate,
    Reference,
    VoltageCommand,
)


@pytest.mark.parametrize('frame', ['', 'a', 'stage', 'stage_x', 300 * 'x'])
def test_what_is_packed_is_what_rclpy_reads_and_the_other_way(frame: str) -> None:
    point = ReferencePoint(2**40, 0.1, -0.2, 0.3, 50.0, 1e6)
    message = deserialize_message(reference_bytes(head_of(7, 9), point), Reference)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 9)
    assert message.header.frame_id == ''
    names = ('sample', 'displacement', 'velocity', 'acceleration', 'frequency', 'phase')
    assert tuple(getattr(message, name) for name in names) == point

    message.header.frame_id = frame
    head, read = point_of(serialize_message(message))
    assert read == point
    assert stamp_of(head) == (7, 9)
    # The head goes on with the voltage, whatever is in it.
    command = deserialize_message(voltage_bytes(head, 2**63, -1.5), VoltageCommand)
    assert command.header == message.header
    assert (command.sample, command.voltage) == (2**63, -1.5)

    state = ActuatorState(sample=7, voltage=0.1, displacement=math.nan)
    state.header.frame_id = frame
    _, measured = measured_of(serialize_message(state))
    assert measured[:2] == (7, 0.1)
    assert math.isnan(measured.displacement)


def test_other_encodings_are_read_too() -> None:
    state = ActuatorState(sample=7, voltage=0.1, displacement=-1e-9)
    state.header.stamp.sec = 5
    big = struct.pack('>4xiII4xQdd', 5, 0, 1, 7, 0.1, -1e-9)
    head, measured = measured_of(b'\x00\x00' + big[2:])
    assert measured == Measured(7, 0.1, -1e-9)
    assert stamp_of(head) == (5, 0)


def test_only_flat_messages_are_packed() -> None:
    with pytest.raises(TypeError, match='HarmonicState'):
        FlatCodec(HarmonicState)


def test_stamps() -> None:
    message = Reference()
    for sample in (0, 1, 999, 123_456_789):
        stamp_into(message.header.stamp, tick_nanoseconds(sample, 1000.0))
        assert nanoseconds_of(message.header.stamp) == sample * 1_000_000


@pytest.mark.parametrize('frequency', [0.0, 70.0])
@pytest.mark.parametrize('kind', [OnlineUd, OnlineBank])
def test_an_estimate_is_a_model_by_itself(kind: type[OnlineUd], frequency: float) -> None:
    method = kind(UdSettings(voltage_range=2.0, natural_frequency=frequency))
    message = ModelEstimate()
    estimate_into(method.estimate(), method.model(), message)
    loaded = model_from(message)
    assert [block.name for block in loaded.model.blocks] == [
        block.name for block in method.model().blocks
    ]
    for name, value in method.estimate().parameters().items():
        assert loaded.values[name] == value
    if kind is OnlineBank:
        assert loaded.values['pi_range'] == 2.0


def test_an_estimate_without_a_model_is_reported() -> None:
    message = ModelEstimate()
    estimate_into(online('rls').estimate(), None, message)
    with pytest.raises(ModelError, match='belongs to no model'):
        model_from(message)
    # The start of the papers' recursion cannot be simulated: it belongs to a model but makes none.
    estimate_into(online('rls').estimate(), named('extended'), message)
    assert message.model == 'extended'
    with pytest.raises(ModelError, match='unstable'):
        model_from(message)
