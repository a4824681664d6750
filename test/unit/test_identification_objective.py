"""Cost and linearisation of the objective give the same sum of squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.identification.targets import whole
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record

DT = 1e-3
BEGINS = RecordStart('estimate', (0.7,))


@pytest.mark.parametrize('own_zero', [False, True])
@pytest.mark.parametrize('name', ['bouc_wen_mode', 'prandtl_ishlinskii'])
def test_cost_and_linearisation_agree_where_the_start_is_estimated(
    name: str, own_zero: bool
) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(800) * DT
    u = np.sin(2 * np.pi * 5 * t + 1.0)
    y = 4e-5 * np.sin(2 * np.pi * 5 * t + 0.9) + 1e-6 * rng.standard_normal(t.size)
    record = Record('r', DT, u, y)
    model = suited(named(name), [record])
    target = replace(whole(record, begins=BEGINS), own_zero=own_zero)
    target = replace(target, influence=rng.uniform(0.3, 1.0, target.measured.size))
    free = (*model.free_names, SAMPLING_OFFSET)
    values = {**model.defaults(), SAMPLING_OFFSET: 2e-4}
    objective = Objective(model, [target], free, values)
    x = np.array([values[each] for each in free])
    squares = objective.linearise(x)[2]
    assert objective.cost(x) == pytest.approx(squares, rel=1e-9)
    assert squares > 0.0


def test_a_fit_does_not_reach_modes_far_above_the_sampling_rate() -> None:
    model = named('bouc_wen_oscillator')
    record = Record('r', DT, np.sin(0.1 * np.arange(400)), 1e-5 * np.sin(0.1 * np.arange(400)))
    values = {**model.defaults(), SAMPLING_OFFSET: 0.0}
    objective = Objective(model, [whole(record)], ('mass',), values)
    assert np.isfinite(objective.cost(np.array([values['mass']])))
    for mass, allowed in ((7e-5, True), (5e-5, False)):  # 29 and 38 thousand per second
        assert np.isfinite(objective.cost(np.array([mass]))) == allowed
        assert np.isfinite(objective.linearise(np.array([mass]))[2]) == allowed
    # a mode that is known to be fast stays one
    known = Objective(model, [whole(record)], ('stiffness',), {**values, 'mass': 1e-6})
    assert np.isfinite(known.cost(np.array([values['stiffness']])))
