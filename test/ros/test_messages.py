"""Conversions between messages and the objects of the core keep every number."""

from __future__ import annotations

import pytest

from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification.online import online
from piezo_hysteresis.identification.rls_ud import OnlineUd, UdSettings
from piezo_hysteresis.models import named
from piezo_hysteresis.nodes.messages import (
    estimate_into,
    measured_from,
    model_from,
    point_from,
    point_into,
)
from piezo_interfaces.msg import ActuatorState, ModelEstimate, Reference
from piezo_ros_common.stamps import nanoseconds_of, stamp_into, tick_nanoseconds


def test_references_and_states() -> None:
    point = ReferencePoint(2**40, 0.1, -0.2, 0.3, 50.0, 1e6)
    message = Reference()
    point_into(point, message)
    assert point_from(message) == point
    state = ActuatorState(sample=7, voltage=0.1, displacement=-1e-9)
    assert measured_from(state) == Measured(7, 0.1, -1e-9)


def test_stamps() -> None:
    message = Reference()
    for sample in (0, 1, 999, 123_456_789):
        stamp_into(message.header.stamp, tick_nanoseconds(sample, 1000.0))
        assert nanoseconds_of(message.header.stamp) == sample * 1_000_000


@pytest.mark.parametrize('frequency', [0.0, 70.0])
@pytest.mark.parametrize('kind', ['bouc_wen', 'play_bank'])
def test_an_estimate_is_a_model_by_itself(kind: str, frequency: float) -> None:
    method = OnlineUd(UdSettings(kind=kind, voltage_range=2.0, natural_frequency=frequency))
    message = ModelEstimate()
    estimate_into(method.estimate(), method.model(), message)
    loaded = model_from(message)
    assert [block.name for block in loaded.model.blocks] == [
        block.name for block in method.model().blocks
    ]
    for name, value in method.estimate().parameters().items():
        assert loaded.values[name] == value
    if kind == 'play_bank':
        assert loaded.values['pi_range'] == 2.0


def test_an_estimate_without_a_model_says_so() -> None:
    message = ModelEstimate()
    estimate_into(online('rls').estimate(), None, message)
    with pytest.raises(ModelError, match='belongs to no model'):
        model_from(message)
    # The start of the papers' recursion cannot be simulated: it belongs to a model but makes none.
    estimate_into(online('rls').estimate(), named('extended'), message)
    assert message.model == 'extended'
    with pytest.raises(ModelError, match='unstable'):
        model_from(message)
