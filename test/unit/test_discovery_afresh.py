"""The right effect gets on from where the baseline began, not from where it went without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.afresh import better_of_both, first_values
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.free import FreeEvaluator
from piezo_hysteresis.discovery.selection.screen import ScreeningScore
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

HIDDEN = {'effects.sensor_nonlinearity': True}
PLAN = [
    {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 1.0}
    for f, a in ((2, 1.0), (7, 0.5), (19, 1.0), (43, 0.7))
]
SAMPLES = 30_000
#: A loop from which no fit comes back.
ASTRAY = {'beta': 8.0, 'gamma': 5.0}


@pytest.fixture(scope='module')
def records() -> list[Record]:
    return simulate('generic_bouc_wen', PLAN, HIDDEN, 2)


@pytest.fixture(scope='module')
def astray(records: list[Record]) -> CandidateFit:
    """Return a baseline fitted from a loop far off."""
    model = suited(named('classical'), records)
    evaluator = FreeEvaluator(split(records), 0, 1)
    return evaluator.refit(evaluator.judged(ModelSpec(model, model.defaults() | ASTRAY)))


def searching(records: list[Record], *hints: dict[str, float]) -> FreeEvaluator:
    return FreeEvaluator(split(records), 0, 1, hints=hints)


def test_first_values_do_not_depend_on_where_the_baseline_went(
    records: list[Record], astray: CandidateFit
) -> None:
    data = split(records)
    found = first_values(astray, data, SAMPLES)
    other = first_values(replace(astray, values=astray.model.defaults()), data, SAMPLES)
    assert found == other
    assert found.keys() == astray.values.keys()
    assert found['beta'] == pytest.approx(1.2, rel=0.5)  # as it is


def test_what_a_model_holds_stays(records: list[Record], astray: CandidateFit) -> None:
    held = replace(astray, model=astray.model.hold(beta=0.7), values=astray.values | {'beta': 0.7})
    assert first_values(held, split(records), SAMPLES)['beta'] == 0.7


def test_the_right_effect_gets_on_from_there(records: list[Record], astray: CandidateFit) -> None:
    evaluator = searching(records, first_values(astray, split(records), SAMPLES))
    (found,) = [
        c for c in evaluator.candidates(astray) if c.effect.variant == 'sensor_nonlinearity'
    ]
    begun = found.values(astray.values, found.starts[0])
    fit = evaluator.fit_briefly(astray.with_candidate(found, begun), 40)
    assert fit is not None
    assert fit.floors > 10.0
    score = ScreeningScore(found, (begun,), 0.5)
    (better,) = better_of_both(evaluator, astray, [score], [fit])
    assert better.floors < 1.1
    assert better.values['beta'] == pytest.approx(1.2, rel=0.02)
    # without the baseline's first values there is nowhere else to begin
    assert better_of_both(searching(records), astray, [score], [fit]) == [fit]


def test_no_first_fit_becomes_worse_and_one_with_an_effect_stays(
    records: list[Record], astray: CandidateFit
) -> None:
    nowhere = {name: float(np.nextafter(1e6, 0.0)) for name in ('beta', 'gamma')}
    evaluator = searching(records, nowhere)
    found = next(c for c in evaluator.candidates(astray) if c.effect.name == 'stiffness')
    spec = astray.with_candidate(found, found.values(astray.values, found.starts[0]))
    fit = evaluator.fit_briefly(spec, 16)
    assert fit is not None
    assert better_of_both(evaluator, astray, (), [fit]) == [fit]
    assert better_of_both(evaluator, fit, (), [fit]) == [fit]
