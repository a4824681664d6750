"""A selection round on synthetic residuals: tested and kept candidates, winner, probability."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection import rounds, search
from piezo_hysteresis.discovery.selection.baseline import fitted_baselines
from piezo_hysteresis.discovery.selection.candidate_fit import Added, CandidateFit, evaluated_on
from piezo_hysteresis.discovery.selection.elimination import Step, pruned
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator, explained_together
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.discovery.selection.rules import (
    Improvement,
    block_squares,
    improvement,
    win_shares,
)
from piezo_hysteresis.discovery.selection.screen import ScreeningScore
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import add_effect, described, named
from piezo_sim.sweep import simulate
from studies.worlds.simulated_world import draw, records_of

MODEL = named('linear_mode')
EDGES = [[*range(0, 1001, 20)]]


def fit(*added: tuple[str, str], error: FloatArray | None = None) -> CandidateFit:
    """Return a model with effects that leaves a residual."""
    left = np.ones(1000) if error is None else error
    parts = tuple(Added(name, variant, {}) for name, variant in added)
    return CandidateFit(MODEL, {}, parts, errors=(left,), noises=(1.0,), precisions=(1.0,))


def noise(size: float, seed: int = 0) -> FloatArray:
    return size * np.random.default_rng(seed).standard_normal(1000)


def scored(name: str, variant: str, explained: float, refines: str = '') -> ScreeningScore:
    effect = SimpleNamespace(name=name, variant=variant, refines=refines)
    return ScreeningScore(cast(Any, SimpleNamespace(effect=effect)), (), explained)


def names(scores: list[ScreeningScore]) -> list[str]:
    return [f'{s.candidate.effect.name}/{s.candidate.effect.variant}' for s in scores]


def test_an_effect_of_many_variants_leaves_room_for_others() -> None:
    many = [scored('creep', str(k), 0.9 - 0.01 * k) for k in range(5)]
    scores = [*many, scored('drift', 'a', 0.5), scored('offset', 'a', 1e-6)]
    chosen = rounds.choose_trials(scores, 1e-4, POLICY.but(trials=6, variants_first=2))
    assert names(chosen) == ['creep/0', 'creep/1', 'drift/a', 'creep/2', 'creep/3', 'creep/4']
    few = POLICY.but(trials=3, variants_first=2)
    assert names(rounds.choose_trials(scores, 1e-4, few)) == ['creep/0', 'creep/1', 'drift/a']
    assert names(rounds.choose_trials(scores, 0.87, few)) == ['creep/0', 'creep/1', 'creep/2']


def test_a_richer_way_is_never_the_first_of_an_effect() -> None:
    scores = [
        scored('sensor', 'spline', 0.9, 'cubic'),
        scored('sensor', 'cubic', 0.5),
        scored('drift', 'a', 0.4),
    ]
    alone = POLICY.but(trials=3, variants_first=1)
    assert names(rounds.choose_trials(scores, 1e-4, alone)) == [
        'sensor/cubic',
        'drift/a',
        'sensor/spline',
    ]
    both = POLICY.but(trials=2, variants_first=2)
    assert names(rounds.choose_trials(scores, 1e-4, both)) == ['sensor/spline', 'sensor/cubic']


def test_the_best_trials_are_continued() -> None:
    tried = [fit(('a', 'x'), error=noise(k)) for k in (3.0, 1.0, 2.0)]
    evaluator = SimpleNamespace(
        map=lambda function, items: [function(each) for each in items],
        policy=POLICY.but(first_fits=2),
        score=lambda each: each.square,
        evaluated_for_ranking=lambda each: each,
    )
    assert rounds.choose_first_fits(cast(Any, evaluator), tried) == [tried[1], tried[2]]


def test_a_time_limit_skips_a_leading_effect_but_no_leading_change() -> None:
    change, effect = (fit((name, 'x'), error=noise(1.0)) for name in ('parameter_shift', 'a'))
    evaluator: Any = SimpleNamespace(
        deadline=Deadline(1e-9),
        policy=POLICY,
        workers=1,
        fit_briefly=lambda each, *given: each,
        sharpened=lambda each: each,
        evaluated_for_ranking=lambda each: each,
    )
    assert rounds.first_fit(evaluator, change, np.inf, True) is change
    assert rounds.first_fit(evaluator, change, np.inf, False) is None
    assert rounds.first_fit(evaluator, effect, np.inf, True) is None
    assert list(evaluator.deadline.untried) == ['parameter_shift', 'a']


def test_followers_need_only_approach_the_leader() -> None:
    fits = [fit(('a', 'x'), error=noise(k)) for k in (1.0, 2.0, 3.0)]
    asked: list[float] = []

    def gone_on(each: CandidateFit, enough: float) -> CandidateFit | None:
        asked.append(enough)
        return None if each is fits[1] else each

    evaluator = cast(
        FreeEvaluator,
        SimpleNamespace(
            map=lambda function, items: [function(each) for each in items],
            enough=lambda best, within: within * best.square,
        ),
    )
    assert FreeEvaluator.with_early_stopping(evaluator, gone_on, fits, 4.0) == [fits[0], fits[2]]
    assert asked == [np.inf, 4.0 * fits[0].square, 4.0 * fits[0].square]
    asked.clear()
    assert FreeEvaluator.with_early_stopping(evaluator, gone_on, fits[2:], 2.0, fits[0]) == [
        fits[2]
    ]
    assert asked == [2.0 * fits[0].square]
    assert FreeEvaluator.with_early_stopping(evaluator, gone_on, [], 2.0) == []
    # one that is no effect sets no measure
    asked.clear()
    FreeEvaluator.with_early_stopping(
        evaluator, gone_on, fits, 4.0, wins=lambda best: best is not fits[0]
    )
    assert asked == [np.inf, np.inf, np.inf]


def test_final_fits_are_for_different_effects_that_came_near() -> None:
    creep = [fit(('creep', v), error=noise(s)) for v, s in (('creep', 1.0), ('creep_pair', 1.1))]
    drift = fit(('drift', 'drift'), error=noise(1.9))
    hum = fit(('mains_hum', 'mains_hum'), error=noise(2.1))
    assert rounds.of_different_places([*creep, drift, hum], POLICY) == [creep[0], drift]


class Made:
    """Scores by the rms, and accepts the given names as effects."""

    def __init__(self, sure: set[str], explaining: set[str]) -> None:
        self.sure, self.explaining = sure, explaining
        self.policy = POLICY

    def is_significant(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        return after.effect in self.sure

    def explains_enough(
        self, before: CandidateFit, after: CandidateFit, start: CandidateFit
    ) -> bool:
        return after.effect in self.explaining

    def shares(self, before: CandidateFit, finalists: Any) -> tuple[float, ...]:
        return tuple(0.1 * (1 + k) for k, _ in enumerate(finalists))

    def improvement(self, before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
        return Improvement(before.square - after.square, 7.0, 1e-9)


def test_the_first_that_is_an_effect_wins_the_round() -> None:
    before = fit(error=noise(5.0))
    ordered = [fit((n, n), error=noise(s)) for n, s in (('a', 1.0), ('b', 1.2), ('c', 4.0))]
    every = {'a', 'b', 'c'}
    won = rounds.round_of(cast(Any, Made(every, {'b', 'c'})), before, ordered, 9, before)
    assert won.accepted
    assert [f.effect for f in won.finalists] == ['b', 'c', 'a']
    assert won.probabilities() == pytest.approx({'c': 0.2, 'b': 0.1, 'a': 0.0})
    assert won.gain.square == pytest.approx(before.square - ordered[1].square)
    # what explains as much without being sure stays an alternative
    doubted = rounds.round_of(cast(Any, Made({'b'}, every)), before, ordered, 9, before)
    assert [f.effect for f in doubted.finalists] == ['b', 'a', 'c']
    assert doubted.shares == pytest.approx((0.1, 0.2, 0.3))
    lost = rounds.round_of(cast(Any, Made(every, set())), before, ordered, 9, before)
    assert not lost.accepted
    assert lost.best is ordered[0]
    assert lost.probabilities() == pytest.approx({'c': 0.3, 'b': 0.2, 'a': 0.1})


def test_a_clear_winner_is_not_tested_again() -> None:
    best = fit(('a', 'x'), error=noise(1.0))
    variant, rival = fit(('a', 'y'), error=noise(1.1)), fit(('b', 'z'), error=noise(1.5))
    gain = Improvement(1.0, 9.0, 1e-9)
    clear = rounds.SelectionRound(best, (best, variant, rival), (1.0, 0.0, 0.0), gain, 3)
    assert clear.won_clearly(POLICY)
    near = replace(clear, finalists=(best, variant, fit(('b', 'z'), error=noise(1.3))))
    assert not near.won_clearly(POLICY)


def test_blocks_hold_all_of_a_residual() -> None:
    (squares,) = block_squares([noise(2.0)], EDGES)
    assert squares.size == 50
    assert squares.sum() == pytest.approx(float(noise(2.0) @ noise(2.0)))


def test_an_improvement_everywhere_is_sure_and_one_by_chance_is_not() -> None:
    before, after = fit(error=noise(2.0)), fit(error=noise(1.0, 1))
    sure = improvement(before, after, 30)
    assert sure.ratio > POLICY.min_standard_errors
    assert sure.p_value < 1e-9
    chance = improvement(fit(error=noise(1.0)), fit(error=noise(1.0, 1)), 30)
    assert abs(chance.ratio) < 3.0
    assert chance.p_value > 0.05


def test_a_p_value_counts_candidates() -> None:
    before, after = fit(error=noise(1.1)), fit(error=noise(1.0))
    one, many = (improvement(before, after, n).p_value for n in (1, 30))
    assert many == pytest.approx(min(1.0, 30 * one))


def test_a_moment_is_sure_and_what_repeats_is_one_number() -> None:
    moment = np.zeros(1000)
    moment[300:320] = 6.0
    moment -= moment @ noise(1.0) / (noise(1.0) @ noise(1.0)) * noise(1.0)
    clear = improvement(fit(error=noise(1.0) + moment), fit(error=noise(1.0)), 1)
    assert clear.ratio > POLICY.min_standard_errors
    line = 30.0 * np.sin(2 * np.pi * 20 * np.arange(1000) / 1000)
    repeated = improvement(fit(error=noise(1.0) + 1.3 * line), fit(error=noise(1.0) + line), 1)
    assert repeated.square > 100.0 * clear.square
    assert repeated.ratio < POLICY.min_standard_errors


def test_resamples_share_undecided_candidates() -> None:
    same = [fit(error=noise(1.0, k)) for k in (1, 2)]
    shares = win_shares(same, [0.0, 0.0], EDGES, 3, 2000)
    assert shares.sum() == pytest.approx(1.0)
    assert 0.02 < shares[0] < 0.98
    clear = win_shares([same[0], fit(error=noise(3.0))], [0.0, 0.0], EDGES, 3, 2000)
    assert clear[0] == 1.0
    # a penalty decides between equals
    assert win_shares([same[0], same[0]], [0.1, 0.0], EDGES, 3, 2000)[1] == 1.0


def test_values_that_all_records_determine_better_are_named() -> None:
    def known(**std: float) -> CandidateFit:
        model = SimpleNamespace(free_names=tuple(std))
        fitted = SimpleNamespace(std=std)
        return cast(CandidateFit, SimpleNamespace(model=model, fitted=fitted))

    text = explained_together(known(a=1.0, b=1.0, c=1.0), known(a=0.9, b=0.1, c=0.5))
    assert '(b, c)' in text
    assert '(' not in explained_together(known(a=1.0), known(a=1.0))


def stepped(*added: tuple[str, str]) -> Step:
    fitted = fit(*added)
    gain = Improvement(1.0, 9.0, 1e-9)
    return Step(rounds.SelectionRound(fitted, (fitted,), (1.0,), gain, 3), fitted)


def test_steps_are_those_whose_effects_the_model_has() -> None:
    delay, lag = ('transport_delay', 'a'), ('amplifier_lag', 'b')
    first, last = stepped(delay), stepped(delay, lag).round
    both = search.steps_of(fit(delay, lag), [first], last)
    assert [step.fit.effect for step in both] == ['transport_delay', 'amplifier_lag']
    assert [step.round.best.effect for step in both] == ['transport_delay', 'amplifier_lag']
    newest = search.steps_of(fit(lag), [first], last)
    assert [step.round.best.effect for step in newest] == ['amplifier_lag']
    # the new one brought the old one to its place and was needless then
    ended = fit(delay, error=noise(0.1))
    (oldest,) = search.steps_of(ended, [first], last)
    assert oldest.round is first.round
    assert oldest.fit is ended


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
    base, _ = fitted_baselines(data, named('classical'), RecordAssumptions())
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


@pytest.mark.component
def test_a_baseline_that_describes_the_records_leaves_their_noise() -> None:
    """From four starting points it ended at three noise floors, with a memory named."""
    hidden = draw('null', 7, 301, 'poor')
    data = split(records_of(hidden))
    base, _ = fitted_baselines(
        data, named(hidden.world.baseline), RecordAssumptions(zero='record')
    )
    assert base.joint.floors < 1.2
