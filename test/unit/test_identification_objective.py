"""Derivatives of the residual of a record in motion."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.identification.fit_data import led_in, whole
from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.models import Model, add_effect, described, named
from piezo_hysteresis.records import Record, RecordInfo

DT = 1e-4
OWN = {'natural_frequency': 540.0, 'damping_ratio': 0.026}
LATE = 3e-6


def chain(effect: str) -> tuple[Model, dict[str, float]]:
    base = named('bouc_wen_mode')
    values = base.defaults() | OWN
    if not effect:
        return base, values
    found = add_effect(base, described(effect)[0])
    return found.model, found.values(values, {found.added[0]: 2.6e-4})


@pytest.mark.parametrize('effect', ['', 'transport_delay'])
def test_a_loop_that_does_not_follow_spoils_no_derivatives_of_a_mode(effect: str) -> None:
    # a step that came late: what the states at the start would have to be is far from rest
    t = DT * np.arange(2000)
    u = np.sin(2 * np.pi * 31.0 * t + 1.2)
    base, values = chain('')
    late = np.concatenate([np.zeros(3), u])[: u.size]
    y = base.respond(late, base.pack(values), DT, state=base.initial_state(DT))
    record = Record('31 Hz', DT, u, y, info=RecordInfo(excitation='sine', frequency=31.0))
    target = led_in(whole(record), record, RecordStart('estimate'))
    model, known = chain(effect)
    free = [*model.free_names, SAMPLING_OFFSET]
    objective = Objective(model, [target], free, {**known, SAMPLING_OFFSET: LATE})
    x = np.array([{**known, SAMPLING_OFFSET: LATE}[name] for name in free])
    factor, rhs, _ = objective.linearise(x)
    gradient = factor.T @ rhs
    for j, name in enumerate(free):
        step = 1e-6 * max(abs(x[j]), 1e-6)
        above, below = x.copy(), x.copy()
        above[j], below[j] = x[j] + step, x[j] - step
        slope = (objective.cost(above) - objective.cost(below)) / (2 * step)
        assert gradient[j] == pytest.approx(slope, rel=0.05), name


def test_friction_at_rest_spoils_no_derivatives_of_a_mode() -> None:
    # after a step the mode comes to rest; its velocity is then a rounding error
    base = named('bouc_wen_mode')
    effect = next(each for each in described('friction') if each.variant == 'in_mode')
    found = add_effect(base, effect)
    values = found.values(base.defaults() | {'natural_frequency': 88.0}, found.starts[0])
    values |= {'damping_ratio': 0.02, 'mode_friction': 1e-6, 'presliding': 8e-7}
    u = np.where(np.arange(9000) < 300, 0.0, 0.8)
    target = whole(Record('step', 1e-3, u, np.zeros(u.size)))
    model = found.model
    free = tuple(model.free_names)
    objective = Objective(model, [target], free, {**values, SAMPLING_OFFSET: 0.0})
    x = np.array([values[name] for name in free])
    factor, rhs, cost = objective.linearise(x)
    assert np.isfinite(cost)
    gradient = factor.T @ rhs
    for name in ('natural_frequency', 'mode_friction'):
        j = free.index(name)
        step = 1e-5 * x[j]
        above, below = x.copy(), x.copy()
        above[j], below[j] = x[j] + step, x[j] - step
        slope = (objective.cost(above) - objective.cost(below)) / (2 * step)
        assert gradient[j] == pytest.approx(slope, rel=0.05), name
