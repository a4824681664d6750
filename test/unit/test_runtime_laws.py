"""Laws that the parameters of a link describe, without a node."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.compensation.feedback.pid import Pid
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    HarmonicAttenuation,
    ScheduledAttenuation,
)
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.parameters.links import ATTENUATION, FEEDBACK
from piezo_hysteresis.runtime.laws import FeedbackLaws, HarmonicLaws

DT = 1e-3


def values_of(table: ParameterTable, **changes: Any) -> dict[str, Any]:
    return {**table.defaults(), 'rate': 1.0 / DT, **changes}


def step(law: Any, k: int, error: float) -> float:
    point = ReferencePoint(k, error, 0.0, 0.0, 5.0, 0.0)
    return float(law.step(point, 0.1, Measured(k - 1, 0.0, 0.0)))


def test_gains_of_a_pid_change_in_place_and_its_integral_carries_on() -> None:
    laws, values = FeedbackLaws(), values_of(FEEDBACK, method='pid')
    values |= {'pid.proportional': 0.0, 'pid.integral': 1e4, 'pid.derivative': 0.0}
    law = laws.build(values, DT)
    assert isinstance(law, Pid)
    before = [step(law, k, 1e-6) for k in range(50)][-1]
    assert before > 0.1
    values['pid.integral'] = 0.0
    assert laws.adjust(law, values, ['pid.integral'])
    assert step(law, 50, 1e-6) == pytest.approx(before, rel=0.05)
    assert not laws.adjust(law, values, ['pid.integral', 'limits.high'])


def test_only_parameters_of_the_method_in_force_shape_the_feedback() -> None:
    laws = FeedbackLaws()
    none, pid = (values_of(FEEDBACK, method=method) for method in ('none', 'pid'))
    assert laws.build(none, DT) is None
    assert not laws.shapes(none, 'pid.integral')
    assert laws.shapes(pid, 'pid.integral')
    assert not laws.shapes(pid, 'h_infinity.bandwidth')
    assert laws.shapes(none, 'method')


def test_half_a_plant_is_refused_with_the_reason() -> None:
    values = values_of(FEEDBACK, method='h_infinity', **{'plant.numerator': [1.0]})
    with pytest.raises(CompensationError, match='belong together'):
        FeedbackLaws().build(values, DT)


def test_a_new_gain_of_the_plant_keeps_the_attenuation_and_orders_make_a_new_one() -> None:
    laws, values = HarmonicLaws(), values_of(ATTENUATION)
    law = laws.build(values, DT)
    assert isinstance(law, HarmonicAttenuation)
    values['plant.gain'] = 2.0 * values['plant.gain']
    assert laws.adjust(law, values, ['plant.gain'])
    assert not laws.adjust(law, values, ['plant.gain', 'orders'])
    assert laws.shapes(values, 'orders')
    assert not laws.shapes(values, 'limits.high')
    assert laws.build({**values, 'enabled': False}, DT) is None


def test_a_schedule_makes_a_new_attenuation_and_another_one_is_taken_in_place() -> None:
    values, laws = values_of(ATTENUATION, enabled=True), HarmonicLaws()
    plain = ModelFile.from_name('classical')
    point = OperatingPoint(10.0, 1.0, 1e-4, 0, plain)
    whole = replace(plain, schedule=Schedule((point,)))
    law = laws.build(values, DT, plain)
    assert laws.adjust(law, values, ['plant.gain'], plain)
    assert not laws.adjust(law, values, ['plant.gain'], whole)
    law = laws.build(values, DT, whole)
    assert isinstance(law, ScheduledAttenuation)
    other = replace(whole, schedule=Schedule((replace(point, frequency=23.0),)))
    assert laws.adjust(law, values, ['plant.gain'], other)
    assert not laws.adjust(law, values, ['plant.gain'], plain)
    # a plant by number wins over the model
    values['plant.gain'] = 1e-4
    assert not isinstance(laws.build(values, DT, whole), ScheduledAttenuation)
