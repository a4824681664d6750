"""An effect that only compensates wrong initial conditions is eliminated once they are right."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import Dataset, beginning_like, split
from piezo_hysteresis.discovery.detection.bends import near_finalists
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.elimination import Step, retested
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.rounds import SelectionRound, round_of
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.discovery.selection.search import (
    SelectionResult,
    eliminated,
    led_by_best_start,
    with_odds,
)
from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import Model, add_effect, described, named
from piezo_hysteresis.records import Record, RecordInfo

DT, DELAY, COUNT = 1e-4, 2.5e-4, 3000
OWN = {'natural_frequency': 540.0, 'damping_ratio': 0.026}
NOISE = 1.5e-7
GAIN = Improvement(1.0, 9.0, 1e-6)
SINES = ((1.0, 9.0), (1.0, 31.0), (0.7, 62.0), (0.4, 47.0))


def answer(model: Model, values: dict[str, float], u: np.ndarray) -> np.ndarray:
    return model.respond(u, model.pack(values), DT, state=model.initial_state(DT))


def records() -> list[Record]:
    """Return sines that begin with a step, which arrives late by a tick and a half."""
    base = named('bouc_wen_mode')
    delayed = add_effect(base, described('transport_delay')[0])
    truth = delayed.values(base.defaults() | OWN, {'delay': DELAY})
    random, found = np.random.default_rng(3), []
    for amplitude, frequency in SINES:
        u = amplitude * np.sin(2 * np.pi * frequency * DT * np.arange(COUNT) + 1.2)
        y = answer(delayed.model, truth, u) + NOISE * random.standard_normal(COUNT)
        info = RecordInfo(excitation='sine', frequency=frequency)
        found.append(Record(f'{frequency:g} Hz', DT, u, y, info=info))
    return found


def in_motion(data: Dataset) -> Dataset:
    """Return data whose records seem to begin on their way."""
    moving = [replace(view, begins=RecordStart('estimate')) for view in data.training]
    return beginning_like(data, moving)


def given(
    evaluator: FreeEvaluator, fit: CandidateFit, name: str, variant: str, value: float
) -> CandidateFit:
    """Return the model of `fit` with an effect of one parameter, fitted."""
    effect = next(e for e in described(name) if e.variant == variant)
    found = add_effect(fit.model, effect)
    spec = fit.with_candidate(found, found.values(fit.values, {found.added[0]: value}))
    fitted = evaluator.fit(spec)
    assert fitted is not None
    return fitted


@pytest.fixture(scope='module')
def scene() -> tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit]:
    """Return the baseline in motion, and it with a delay, with a lag and with both."""
    evaluator = FreeEvaluator(in_motion(split(records())), 0, 1, choices=RecordAssumptions())
    base = named('bouc_wen_mode')
    start = evaluator.evaluated(ModelSpec(base, base.defaults() | OWN))
    delay = given(evaluator, start, 'transport_delay', 'transport_delay', DELAY)
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    both = given(evaluator, lag, 'transport_delay', 'transport_delay', 0.7 * DELAY)
    return evaluator, start, delay, both


@pytest.mark.component
def test_a_lag_is_eliminated_if_a_delay_implies_a_start_with_a_step(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
) -> None:
    evaluator, start, delay, both = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    assert not evaluator.is_as_good(delay, both)
    first = round_of(evaluator, start, [lag, delay], 2, start)
    last = round_of(evaluator, lag, [both], 1, start)
    chosen, steps, final = retested(evaluator, start, [Step(first, lag), Step(last, both)])
    assert [added.effect for added in final.added] == ['transport_delay']
    assert [step.fit.effect for step in steps] == ['transport_delay']
    assert {view.begins.kind for view in chosen.views} == {'step'}
    assert final.floors < 1.05
    late = final.values['delay'] - final.sampling_offset
    assert late == pytest.approx(DELAY, rel=0.02)


def test_a_search_without_time_lists_nothing_unlikely_or_at_a_bound(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
) -> None:
    evaluator, start, delay, both = scene
    ended = copy(evaluator)
    ended.deadline = Deadline(1e-9)
    lag = both.added[0]

    def names(fit: CandidateFit, share: float, *rivals: CandidateFit) -> list[str]:
        middle = replace(fit, added=fit.added[:1])
        shares = (share, *(0.0 for _ in rivals))
        unlikely = SelectionRound(start, (middle, *rivals), shares, GAIN, 2)
        last = SelectionRound(middle, (fit,), (1.0,), GAIN, 2)
        steps = (Step(unlikely, middle), Step(last, fit))
        found = eliminated(SelectionResult(ended, start, fit, steps))
        assert {added.effect for added in found.final.added} == {s.fit.effect for s in found.steps}
        return [step.fit.effect for step in found.steps]

    assert names(both, 0.6) == ['amplifier_lag', 'transport_delay']
    assert names(both, 0.0) == ['transport_delay']
    # a rival that leaves clearly less, whatever its probability, was not compared to the end
    assert names(both, 0.6, delay) == ['amplifier_lag', 'transport_delay']
    less = replace(delay, errors=tuple(0.1 * each for each in both.errors))
    assert names(both, 0.6, less) == ['transport_delay']
    (time,) = lag.names.values()
    high = next(q.high for q in both.model.parameters if q.name == time)
    assert names(replace(both, values=both.values | {time: high}), 0.6) == ['transport_delay']
    assert 'elimination of redundant effects' in ended.deadline.untried


@pytest.mark.parametrize(('away', 'names'), [(0.01, ['transport_delay']), (0.5, [])])
def test_a_finalist_with_the_same_residual_is_in_the_class(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
    away: float,
    names: list[str],
) -> None:
    """Of 7200 values of unit variance a hundredth is one standard deviation, a half is 42."""
    evaluator, start, delay, _ = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    other = replace(delay, errors=tuple((1.0 + away) * each for each in lag.errors))
    step = Step(SelectionRound(start, (lag, other), (1.0, 0.0), GAIN, 2), lag)
    found = near_finalists(evaluator, step)
    assert [alike.name for alike, _ in found] == names
    assert all(0.5 < alike.distance < 1.5 for alike, _ in found)


def test_an_effect_that_wins_after_a_restart_has_the_odds_of_its_model(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
) -> None:
    """In the first round, without the other effects, it had no chance."""
    evaluator, start, delay, _ = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    restarted = SelectionRound(start, (delay, lag), (0.0, 1.0), GAIN, 2)

    def odds(share: float) -> dict[str, float]:
        better = replace(delay, errors=tuple(share * each for each in lag.errors))
        rival = SelectionResult(evaluator, start, lag)
        won = SelectionResult(evaluator, start, better, (Step(restarted, better),))
        return with_odds(won, restarted, rival).steps[0].round.probabilities()

    assert odds(0.1) == {'transport_delay': 1.0, 'amplifier_lag': 0.0}
    near = odds(1.0 - 1e-9)
    assert sum(near.values()) == pytest.approx(1.0)
    # an effect that the rival has, too, is not in doubt
    both = SelectionResult(evaluator, start, replace(lag, added=(*lag.added, *delay.added)))
    won = SelectionResult(evaluator, start, delay, (Step(restarted, delay),))
    assert with_odds(won, restarted, both).steps[0].round.shares == (1.0, 0.0)


@pytest.mark.parametrize('accepted', [True, False])
def test_a_rival_with_better_initial_conditions_wins(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit], accepted: bool
) -> None:
    evaluator, start, delay, _ = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    first = round_of(evaluator, start, [lag, delay], 2, start)
    chosen, round_ = led_by_best_start(evaluator, replace(first, accepted=accepted), start)
    assert round_.accepted
    assert round_.best.effect == 'transport_delay'
    assert round_.best.floors < 1.05
    assert {fit.effect for fit in round_.finalists} == {'transport_delay', 'amplifier_lag'}
    assert {view.begins.kind for view in chosen.views} == {'step'}
    # knowing that, no rival tells anything else
    same, again = led_by_best_start(chosen, round_, start)
    assert (same, again) == (chosen, round_)


def test_finalists_of_equal_values_and_other_residuals_are_told_apart(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evaluator, start, delay, _ = scene
    lag = given(evaluator, start, 'amplifier_lag', 'sensor_lag', DELAY)
    first = round_of(evaluator, start, [lag, delay], 2, start)
    renewed: list[CandidateFit] = []

    def with_own_starts(fit: CandidateFit) -> tuple[FreeEvaluator, CandidateFit]:
        renewed.append(replace(fit, errors=tuple(0.1 * each for each in fit.errors)))
        return evaluator, renewed[-1]

    monkeypatch.setattr(evaluator, 'with_own_starts', lambda fit: (evaluator, fit))
    assert led_by_best_start(evaluator, first, start)[1] is first  # nothing starts better
    monkeypatch.setattr(evaluator, 'with_own_starts', with_own_starts)
    monkeypatch.setattr(evaluator, 'explains_enough', lambda *_: False)
    chosen, round_ = led_by_best_start(evaluator, first, start)
    assert chosen is evaluator
    assert round_.finalists[1] is renewed[0]
    assert round_.best is first.best


@pytest.mark.parametrize('accepted', [True, False])
def test_an_effect_that_would_not_be_added_to_the_others_does_not_stay(
    scene: tuple[FreeEvaluator, CandidateFit, CandidateFit, CandidateFit],
    monkeypatch: pytest.MonkeyPatch,
    accepted: bool,
) -> None:
    """A search that begins with an unlikely effect must not keep it because it fits somewhat."""
    evaluator, start, delay, both = scene
    lag = both.added[0]
    middle = replace(both, added=both.added[:1])
    close = replace(middle, added=(replace(lag, effect='creep'),))  # no clear win of the lag
    first = SelectionRound(start, (middle, close), (0.0, 1.0), GAIN, 2)
    last = SelectionRound(middle, (both,), (1.0,), GAIN, 2)
    again = SelectionRound(delay, (both,), (1.0,), GAIN, 2, accepted)
    again = replace(again, finalists=(replace(both, added=both.added[::-1]),))
    monkeypatch.setattr(evaluator, 'is_as_good', lambda *_: False)
    monkeypatch.setattr(evaluator, 'with_own_starts', lambda fit: (evaluator, fit))
    monkeypatch.setattr(
        'piezo_hysteresis.discovery.selection.elimination.select', lambda *_: again
    )
    _, steps, final = retested(evaluator, start, [Step(first, middle), Step(last, both)])
    kept = ['amplifier_lag', 'transport_delay'] if accepted else ['transport_delay']
    assert [step.fit.effect for step in steps] == kept
    assert sorted(added.effect for added in final.added) == kept
    if accepted:
        assert steps[0].round.probabilities() == {'amplifier_lag': 1.0}
