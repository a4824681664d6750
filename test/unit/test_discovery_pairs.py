"""Two effects of which each hides the other are found together, or not at all."""

from __future__ import annotations

from copy import copy
from typing import Any, cast

import numpy as np
import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.selection import search as searching
from piezo_hysteresis.discovery.selection.candidate_fit import Added, CandidateFit
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.discovery.selection.rounds import SelectionRound
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.models import named
from studies.worlds.simulated_world import draw, records_of

MODEL = named('linear_mode')
GAIN = Improvement(1.0, 9.0, 1e-9)


def fit(*effects: str, left: float = 1.0) -> CandidateFit:
    """Return a model with effects that leaves a residual of some noise rms."""
    added = tuple(Added(name, name, {}) for name in effects)
    error = left * np.ones(100)
    return CandidateFit(MODEL, {}, added, errors=(error,), noises=(1.0,), precisions=(1.0,))


class Hiding:
    """Both of a pair explain all of it, one of them nothing that is sure."""

    def __init__(self, ends_at: float, seconds: float = np.inf, most: int = 5) -> None:
        self.ends_at, self.deadline = ends_at, Deadline(seconds)
        self.policy = POLICY.but(elimination_rounds=0, max_effects=most)

    def noting_apart(self) -> Hiding:
        other = copy(self)
        other.deadline = Deadline(self.deadline.seconds)
        return other

    def with_tones_aligned(self, current: CandidateFit) -> Hiding:
        return self

    def evaluated(self, spec: CandidateFit) -> CandidateFit:
        return spec

    def has_significant_residual(self, current: CandidateFit, start: CandidateFit) -> bool:
        return current.floors > 1.1

    def starts_may_differ(self, found: CandidateFit) -> bool:
        return False

    def explains_enough(self, *fits: CandidateFit) -> bool:
        return True

    def is_significant(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        return len(after.added) > 1


def search(
    monkeypatch: pytest.MonkeyPatch, evaluator: Hiding, beyond: dict[str, str]
) -> tuple[list[str], list[str]]:
    """Return the effects found and those whose rounds ran, if `beyond` says what follows each."""
    rounds: list[str] = []

    def select(_: Any, before: CandidateFit, *rest: Any) -> SelectionRound:
        rounds.append(before.effect)
        if not before.added:
            leads = tuple(fit(name, left=3.0) for name in beyond)
            return SelectionRound(before, leads[:1], (1.0,), GAIN, 9, accepted=False, leads=leads)
        other = beyond[before.effect]
        both = fit(before.effect, other, left=evaluator.ends_at)
        return SelectionRound(before, (both,), (1.0,), GAIN, 9)

    def without(_: Any, final: CandidateFit, start: CandidateFit, name: str) -> CandidateFit:
        return fit(*(each.effect for each in final.added if each.effect != name), left=3.0)

    monkeypatch.setattr(searching, 'select', select)
    monkeypatch.setattr(searching, 'without_effect', without)
    found = searching.search(cast(Any, evaluator), fit(left=4.0), lambda fraction, words: None)
    assert [step.fit.effect for step in found.steps] == [
        step.round.best.effect for step in found.steps
    ]
    return [added.effect for added in found.final.added], rounds[1:]


def test_each_of_a_pair_is_found_with_the_other_present(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = {'creep': 'resonance', 'resonance': 'creep'}
    names, rounds = search(monkeypatch, Hiding(ends_at=1.0), pair)
    assert names == ['resonance', 'creep']
    assert rounds == ['creep', 'resonance']


def test_a_first_fit_that_leads_astray_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    beyond = {'rate_dependence': 'creep', 'creep': 'resonance', 'resonance': 'creep'}
    names, _ = search(monkeypatch, Hiding(ends_at=1.0), beyond)
    assert names == ['creep', 'resonance']


@pytest.mark.parametrize(
    ('evaluator', 'beyond', 'count'),
    [
        pytest.param(
            Hiding(ends_at=1.5), {'creep': 'resonance', 'resonance': 'creep'}, 2,
            id='what both leave is more than noise',
        ),
        pytest.param(Hiding(ends_at=1.0), {'creep': 'creep'}, 1, id='no other effect'),
        pytest.param(
            Hiding(ends_at=1.0, seconds=1e-9), {'creep': 'resonance', 'resonance': 'creep'}, 0,
            id='the time is over',
        ),
        pytest.param(
            Hiding(ends_at=1.0, most=1), {'creep': 'resonance', 'resonance': 'creep'}, 0,
            id='one effect at most',
        ),
    ],
)  # fmt: skip
def test_no_pair_is_named(
    monkeypatch: pytest.MonkeyPatch, evaluator: Hiding, beyond: dict[str, str], count: int
) -> None:
    names, rounds = search(monkeypatch, evaluator, beyond)
    assert names == []
    assert len(rounds) == count


def test_what_the_rounds_of_a_pair_skip_was_tried_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    evaluator = Hiding(ends_at=1.5)

    def round_of_pair(apart: Any, *_: Any) -> None:
        apart.deadline.untried['creep'] = None

    monkeypatch.setattr(searching, '_round_of_pair', round_of_pair)
    search(monkeypatch, evaluator, {'creep': 'resonance', 'drift': 'creep'})
    assert list(evaluator.deadline.untried) == ['pairs with creep', 'pairs with drift']


@pytest.mark.slow
def test_creep_and_a_second_mode_are_named_though_neither_alone_is_sure() -> None:
    """A mode alone fits what creep leaves, with a damping at the end of its range."""
    hidden = draw('pair', 5, 111)
    found = discover(records_of(hidden), named(hidden.world.baseline), seed=1).verdict
    assert {effect.name for effect in found.effects} == {'creep', 'resonance'}
    assert min(effect.probability for effect in found.effects) > 0.5
    assert found.held_out.after_in_floors < 1.1
