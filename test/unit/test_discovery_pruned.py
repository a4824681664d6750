"""An effect that only helped another to its place does not stay in the model."""

from __future__ import annotations

from dataclasses import replace

import pytest

from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.baseline import fitted_baselines
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, evaluated_on
from piezo_hysteresis.discovery.selection.elimination import pruned
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.models import add_effect, described, named
from piezo_sim.sweep import simulate

HIDDEN = {
    'effects.resonance': True,
    'structure.natural_frequency': 120.0,
    'structure.damping_ratio': 0.05,
}
RESONANCE = {'resonance_frequency': 120.0, 'resonance_damping': 0.05, 'resonance_share': 1.0}
Scene = tuple[FreeEvaluator, CandidateFit]


@pytest.fixture(scope='module')
def scene() -> Scene:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': 1.0} for f in (2, 7, 19, 43)
    ]
    data = split(simulate('generic_bouc_wen', plan, HIDDEN, 2))
    evaluator = FreeEvaluator(data, 0, 1)
    base, _ = fitted_baselines(data, named('classical'), Choices())
    return evaluator, base.joint


def given(
    evaluator: FreeEvaluator, fit: CandidateFit, name: str, variant: str, values: dict[str, float]
) -> CandidateFit:
    """Return the model of `fit` with an effect of these values, not fitted."""
    effect = next(e for e in described(name) if e.variant == variant)
    found = add_effect(fit.model, effect)
    known = found.values(fit.values, {found.renamed[k]: v for k, v in values.items()})
    evaluated = evaluated_on(fit.with_candidate(found, known), evaluator.views)
    return replace(evaluated, parameters=fit.parameters + 1)


def test_what_changes_nothing_goes_and_takes_what_it_made_needless_along(scene: Scene) -> None:
    evaluator, start = scene
    once = evaluator.refit(given(evaluator, start, 'resonance', 'resonance', RESONANCE))
    assert once.rms < 1.1 * evaluator.floor
    twice = given(evaluator, once, 'resonance', 'resonance', {**RESONANCE, 'resonance_share': 0.0})
    thrice = given(evaluator, twice, 'amplifier_lag', 'sensor_lag', {'sensor_lag_time': 0.0})
    left = pruned(evaluator, thrice, start)
    assert [added.effect for added in left.added] == ['resonance']
    assert left.values['resonance_frequency'] == pytest.approx(120.0, rel=1e-3)
    assert left.rms < 1.1 * evaluator.floor


def test_what_is_needed_stays_untouched(scene: Scene) -> None:
    evaluator, start = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', {'sensor_lag_time': 0.0})
    both = evaluator.refit(given(evaluator, lag, 'resonance', 'resonance', RESONANCE))
    assert pruned(evaluator, both, start) is both


def test_an_effect_that_freed_a_parameter_can_be_taken_out(scene: Scene) -> None:
    evaluator, start = scene
    once = evaluator.refit(given(evaluator, start, 'resonance', 'resonance', RESONANCE))
    (variant,) = {e.variant for e in described('asymmetry') if 'A0' in e.frees}
    twice = given(evaluator, once, 'asymmetry', variant, {'A0': 1e-12})
    left = pruned(evaluator, twice, start)
    assert [added.effect for added in left.added] == ['resonance']
    assert left.values['A0'] == start.values['A0'] == 0.0
