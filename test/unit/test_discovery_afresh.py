"""The right effect gets on from where the baseline began, not from where it went without it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.baseline import first_values
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.rounds import better_of_both
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
    return evaluator.refit(evaluator.evaluated(ModelSpec(model, model.defaults() | ASTRAY)))


class Counted(FreeEvaluator):
    """Begins where it is told."""

    values: dict[str, float] | None = None

    def first_values(self, before: ModelSpec) -> Any:
        return self.values


def offered(
    evaluator: FreeEvaluator, astray: CandidateFit, variant: str
) -> tuple[ScreeningScore, CandidateFit]:
    """Return what is tried, and its first fit from where the baseline went."""
    (found,) = [c for c in evaluator.candidates(astray) if c.effect.variant == variant]
    initial = found.values(astray.values, found.starts[0])
    fit = evaluator.fit_briefly(astray.with_candidate(found, initial), 40)
    assert fit is not None
    return ScreeningScore(found, (initial,), 0.5), fit


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
    evaluator = FreeEvaluator(split(records), 0, 1)
    score, fit = offered(evaluator, astray, 'sensor_nonlinearity')
    assert fit.floors > 10.0
    (better,) = better_of_both(evaluator, astray, [score], [fit])
    assert better.floors < 1.1
    assert better.values['beta'] == pytest.approx(1.2, rel=0.02)
    # one of which the first fit failed may yet get on
    assert better_of_both(evaluator, astray, [score], [])[0].floors < 1.1


def test_the_better_of_both_counts(records: list[Record], astray: CandidateFit) -> None:
    evaluator = Counted(split(records), 0, 1)
    right = evaluator.refit(replace(astray, values=astray.model.defaults()))
    score, fit = offered(evaluator, right, 'sensor_nonlinearity')
    assert fit.floors < 1.1
    evaluator.values = {**right.values, **ASTRAY}
    assert better_of_both(evaluator, right, [score], [fit]) == [fit]


def test_what_is_compared_is_the_end_of_the_fit(
    records: list[Record], astray: CandidateFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = FreeEvaluator(split(records), 0, 1)
    score, _ = offered(evaluator, astray, 'sensor_nonlinearity')
    policy = replace(evaluator.policy, first_evaluations=3)
    monkeypatch.setattr(evaluator, 'policy', policy)
    fits: list[CandidateFit | None] = []
    briefly = evaluator.fit_briefly

    def followed(*given: Any, **named: Any) -> CandidateFit | None:
        fits.append(briefly(*given, **named))
        return fits[-1]

    monkeypatch.setattr(evaluator, 'fit_briefly', followed)
    (better,) = better_of_both(evaluator, astray, [score], [])
    near, end = fits
    assert near is not None
    assert end is not None
    assert better.values == end.values != near.values


def test_a_held_baseline_begins_nowhere_else(records: list[Record], astray: CandidateFit) -> None:
    evaluator = Counted(split(records), 0, 1)
    score, fit = offered(evaluator, astray, 'sensor_nonlinearity')
    assert better_of_both(evaluator, astray, [score], [fit]) == [fit]


def test_only_the_first_effect_begins_there(records: list[Record], astray: CandidateFit) -> None:
    evaluator = Counted(split(records), 0, 1)
    score, fit = offered(evaluator, astray, 'sensor_nonlinearity')
    evaluator.values = first_values(astray, evaluator.data, SAMPLES)
    assert better_of_both(evaluator, fit, [score], [fit]) == [fit]


def test_without_time_nothing_begins_there(records: list[Record], astray: CandidateFit) -> None:
    evaluator = FreeEvaluator(split(records), 0, 1, deadline=Deadline(1e-9))
    score, fit = offered(evaluator, astray, 'sensor_nonlinearity')
    assert better_of_both(evaluator, astray, [score], [fit]) == [fit]
