"""Rounds of real searches, evaluated again with the stored fitted values."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from frozen_rounds import FREE, FROZEN, HELD, free, held, unpacked

from piezo_hysteresis.discovery.selection.candidate_fit import Added, CandidateFit, evaluated_on
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import FixedBaselineEvaluator
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.policy import HELD as HELD_POLICY
from piezo_hysteresis.discovery.selection.rounds import SelectionRound, ranked, round_of, select
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.discovery.selection.screen import ScreeningScore
from piezo_hysteresis.discovery.selection.search import search
from piezo_hysteresis.identification.initial_conditions.record_start import SETTLED
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import EFFECT_NAMES

CONTENT: dict[str, Any] = json.loads((FROZEN / 'rounds.json').read_text('utf-8'))
NAMES = {f'held {kind}': names for kind, names in HELD.items()}
NAMES |= {f'free {kind}': names for kind, names in FREE.items()}
HIDDEN = [world for world, names in NAMES.items() if names]


def setting(world: str) -> tuple[Evaluator, CandidateFit]:
    view, kind = world.split()
    if view == 'held':
        return held(kind)
    return free(kind, CONTENT[world]['base'])


class Round:
    """One round as it was compared."""

    def __init__(self, world: str, place: int) -> None:
        self.evaluator, self.start = setting(world)
        content = CONTENT[world]['rounds'][place]
        self.tried = content['tried']
        self.before = unpacked(self.evaluator, self.start, content['before'])
        fits = [unpacked(self.evaluator, self.start, each) for each in content['finalists']]
        self.finalists = ranked(self.evaluator, fits)

    def evaluated(self) -> SelectionRound:
        return round_of(self.evaluator, self.before, self.finalists, self.tried, self.start)


@pytest.fixture(scope='module')
def first() -> dict[str, Round]:
    """Return the first round of every actuator with an effect."""
    return {world: Round(world, 0) for world in HIDDEN}


def test_the_file_has_every_actuator() -> None:
    assert {world: tuple(each['names']) for world, each in CONTENT.items()} == NAMES


@pytest.mark.parametrize('world', [world for world, names in NAMES.items() if not names])
def test_an_actuator_that_misses_nothing_opens_no_search(world: str) -> None:
    evaluator, base = setting(world)
    assert not evaluator.has_significant_residual(base, base)
    assert not evaluator.remainder(base, base).significant


@pytest.mark.parametrize('world', HIDDEN)
def test_the_hidden_effect_wins_its_round(world: str, first: dict[str, Round]) -> None:
    made = first[world]
    assert made.evaluator.has_significant_residual(made.before, made.start)
    won = made.evaluated()
    assert won.accepted
    assert won.best.effect == NAMES[world][0]
    assert won.gain.p_value < 1e-3
    assert max(won.probabilities(), key=won.probabilities().__getitem__) == won.best.effect
    assert sum(won.shares) == pytest.approx(1.0, abs=1e-6)
    assert not made.evaluator.is_as_good(made.before, won.best)


@pytest.mark.parametrize('world', HIDDEN)
def test_with_the_effect_in_the_model_only_noise_remains(
    world: str, first: dict[str, Round]
) -> None:
    made = first[world]
    best = made.evaluated().best
    assert made.evaluator.excess(best) < 0.1 * made.evaluator.excess(made.before)
    if world.startswith('held'):
        assert not made.evaluator.has_significant_residual(best, made.start)


@pytest.mark.parametrize('world', HIDDEN)
def test_an_effect_at_its_neutral_values_is_none(world: str, first: dict[str, Round]) -> None:
    made = first[world]
    nothing = replace(made.evaluated().best, errors=made.before.errors)
    lost = round_of(made.evaluator, made.before, [nothing], made.tried, made.start)
    assert not lost.accepted


@pytest.mark.parametrize('world', ['held delay', 'held lag'])
def test_an_effect_that_spoils_held_out_records_is_vetoed(
    world: str, first: dict[str, Round]
) -> None:
    made = first[world]
    best = made.evaluated().best
    (name, *_) = best.added[-1].names.values()
    spoiled = replace(best, values={**best.values, name: 5.0 * best.values[name]})
    assert made.evaluator.explains_enough(made.before, best, made.start)
    # the training errors are those of the good fit, so that the veto alone can refuse it
    assert not made.evaluator.explains_enough(made.before, spoiled, made.start)


def test_more_candidates_ask_for_more_evidence(first: dict[str, Round]) -> None:
    made = first['held delay']
    gain = made.evaluator.score(made.before) - made.evaluator.score(made.evaluated().best)
    enough = int(np.exp(min(gain - HELD_POLICY.sure, 30.0)))
    best = made.evaluated().best
    assert made.evaluator.is_significant(made.before, best, max(enough // 2, 1))
    assert not made.evaluator.is_significant(made.before, made.before, 1)


def test_a_better_model_without_new_deviation_needs_no_further_evidence(
    first: dict[str, Round],
) -> None:
    made = first['held delay']
    evaluator, best, many = made.evaluator, made.evaluated().best, 10**15
    assert isinstance(evaluator, FixedBaselineEvaluator)
    assert evaluator.exceeds_discrepancy(made.before)
    adequate = not (
        evaluator.exceeds_discrepancy(best) or evaluator.held_out_exceeds_discrepancy(best)
    )
    assert evaluator.is_significant(made.before, best, many) is adequate
    # nothing was known to be missing before
    assert not evaluator.is_significant(best, best, many)


@pytest.mark.parametrize(('p_value', 'named'), [(0.2, False), (0.01, True)])
def test_one_of_many_candidates_that_any_would_be_is_not_named(
    first: dict[str, Round], monkeypatch: pytest.MonkeyPatch, p_value: float, named: bool
) -> None:
    """A record was flagged before and not afterwards, and the name had p 0.2 and 0.82."""
    made = first['held delay']
    evaluator, best = made.evaluator, made.evaluated().best
    monkeypatch.setattr(evaluator, 'score', lambda fit: 2.0 if fit is made.before else 0.0)
    monkeypatch.setattr(evaluator, 'has_significant_residual', lambda fit, _: fit is made.before)
    monkeypatch.setattr(
        evaluator, 'improvement', lambda *_: Improvement(1.0, 2.0, p_value)
    )  # fmt: skip
    assert evaluator.is_significant(made.before, best, 20) is named


def test_each_name_beyond_the_first_has_a_price() -> None:
    evaluator, base = held('nothing')
    one, another = Added('creep', 'creep', {}), Added('drift', 'drift', {})
    assert evaluator.further_names(replace(base, added=(one,))) == 0.0
    assert evaluator.further_names(replace(base, added=(one, one))) == 0.0
    price = np.log(len(EFFECT_NAMES))
    assert evaluator.further_names(replace(base, added=(one, another))) == pytest.approx(price)


def test_a_level_before_a_record_has_the_price_of_a_parameter() -> None:
    evaluator, base = held('nothing')
    more = evaluator.score(replace(base, levels=2)) - evaluator.score(base)
    assert more == pytest.approx(2.0 * evaluator.policy.price)


def test_the_held_out_excess_is_beyond_the_known_discrepancy() -> None:
    evaluator, base = held('nothing')
    raw = evaluated_on(base, evaluator.data.held_out).floors ** 2 - 1.0
    assert raw > 10.0  # what the model is known to miss, above the noise
    assert abs(evaluator.held_out(base)[1]) < 0.5


def test_a_short_fit_of_a_delay_is_tried_with_the_sampling_offset_of_the_file() -> None:
    evaluator, base = held('delay')
    assert isinstance(evaluator, FixedBaselineEvaluator)
    assert base.sampling_offset < evaluator.late  # makes up for a part of the delay
    (delay,) = (e for e in evaluator.candidates(base) if e.effect.name == 'transport_delay')
    spec = base.with_candidate(delay, delay.values(base.values, {'delay': 2e-3}))
    found, stuck = evaluator.fit_briefly(spec, 10), Evaluator.fit_briefly(evaluator, spec, 10)
    assert found is not None
    assert stuck is not None
    assert found.square < 0.1 * stuck.square
    assert found.sampling_offset == pytest.approx(evaluator.late, rel=0.01)


def test_initial_conditions_of_a_finalist_are_kept_if_they_score_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, base = held('nothing')
    assert isinstance(known, FixedBaselineEvaluator)
    assert known.with_own_starts(base) == (known, base)  # the records keep theirs
    evaluator = FixedBaselineEvaluator(
        known.data, 1, 1, known.base, known.given, choices=RecordAssumptions()
    )
    other = known.data.with_each(lambda view: replace(view, begins=SETTLED))
    monkeypatch.setattr(
        'piezo_hysteresis.discovery.selection.fixed_baseline_evaluator.with_revised_starts',
        lambda *_, **__: other,
    )
    for factor, better in ((0.5, True), (2.0, False)):
        again = replace(base, errors=tuple(factor * each for each in base.errors))
        monkeypatch.setattr(FixedBaselineEvaluator, 'fit', lambda self, spec, again=again: again)
        chosen, fit = evaluator.with_own_starts(base)
        assert (fit is again) == better
        assert ({view.begins for view in chosen.views} == {SETTLED}) == better


def test_a_finalist_that_explains_the_records_from_rest_begins_there(
    first: dict[str, Round], monkeypatch: pytest.MonkeyPatch
) -> None:
    known = first[next(world for world in HIDDEN if world.startswith('free'))]
    evaluator, fit = known.evaluator, known.start
    assert isinstance(evaluator, FreeEvaluator)
    module = 'piezo_hysteresis.discovery.selection.free_evaluator'
    other = evaluator.data.with_each(lambda view: replace(view, begins=SETTLED))
    monkeypatch.setattr(f'{module}.with_renewed_starts', lambda *_: evaluator.data)
    for found, factor, better in (
        ([(other, 1.0)], 0.5, True),
        ([(other, 1.0)], 2.0, False),
        ([(other, 0.2)], 0.5, False),  # worth less than a state of its own costs
        ([], 0.5, False),
    ):
        again = replace(fit, errors=tuple(factor * each for each in fit.errors))
        monkeypatch.setattr(f'{module}.with_other_starts', lambda *_, found=found: found)
        monkeypatch.setattr(FreeEvaluator, 'fit', lambda self, spec, enough, again=again: again)
        chosen, kept = evaluator.with_own_starts(fit)
        assert (kept is again) == better
        assert ({view.begins for view in chosen.views} == {SETTLED}) == better


def test_finalists_estimate_their_starts_before_a_round_is_lost(
    first: dict[str, Round], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = first['held delay']
    lost = replace(found.evaluated(), accepted=False)
    asked: list[SelectionRound] = []

    def led(
        evaluator: Evaluator, round_: SelectionRound, start: CandidateFit
    ) -> tuple[Evaluator, SelectionRound]:
        asked.append(round_)
        return evaluator, round_

    searching = 'piezo_hysteresis.discovery.selection.search'
    monkeypatch.setattr(f'{searching}.select', lambda *_: lost)
    monkeypatch.setattr(f'{searching}.led_by_best_start', led)
    ended = search(found.evaluator, found.start, lambda fraction, words: None)
    assert asked[0] is lost
    assert ended.steps == ()


@pytest.mark.parametrize(('fitted', 'held_out'), [(True, True), (False, True), (False, False)])
def test_what_remains_is_said_also_where_only_held_out_records_show_it(
    monkeypatch: pytest.MonkeyPatch, fitted: bool, held_out: bool
) -> None:
    evaluator, base = held('nothing')
    monkeypatch.setattr(evaluator, 'exceeds_discrepancy', lambda *_: fitted)
    monkeypatch.setattr(evaluator, 'held_out_exceeds_discrepancy', lambda *_: held_out)
    found = evaluator.remainder(base, base)
    assert found.significant == (fitted or held_out)
    shown = evaluator.data.held_out if held_out and not fitted else evaluator.views
    assert [view.name for view in found.views] == [view.name for view in shown]


def test_of_two_starts_of_a_trial_the_better_score_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    evaluator, base = held('delay')
    (delay,) = (e for e in evaluator.candidates(base) if e.effect.name == 'transport_delay')
    values = [delay.values(base.values, {'delay': late}) for late in (1e-3, 2e-3)]
    trial = ScreeningScore(delay, tuple(values), 0.5)
    smaller, better = (base.with_candidate(delay, each) for each in values)
    fits = [evaluator.evaluated(each) for each in (smaller, better)]
    squares = {1e-3: 1.0, 2e-3: 2.0}
    monkeypatch.setattr(CandidateFit, 'square', property(lambda fit: squares[fit.values['delay']]))
    monkeypatch.setattr(evaluator, 'score', lambda fit: -squares[fit.values['delay']])
    monkeypatch.setattr(evaluator, 'fit_briefly', lambda *_: fits.pop(0))
    seen: list[CandidateFit] = []

    def first_fits(_: Evaluator, tried: list[CandidateFit]) -> list[CandidateFit]:
        seen.extend(tried)
        return []

    rounds = 'piezo_hysteresis.discovery.selection.rounds'
    monkeypatch.setattr(f'{rounds}.refined_candidates', lambda *_: [])
    monkeypatch.setattr(f'{rounds}.choose_trials', lambda *_: [trial])
    monkeypatch.setattr(f'{rounds}.choose_first_fits', first_fits)
    monkeypatch.setattr(f'{rounds}.better_of_both', lambda *_: [])
    assert select(evaluator, base, base, lambda fraction, words: None) is None
    assert [fit.values['delay'] for fit in seen] == [2e-3]
