"""Derivatives of the residual of a record in motion."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.targets import led_in, whole
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
