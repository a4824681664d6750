"""A search gets on from where the baseline began; a mode or gain that changed comes first."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.baseline import first_values
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
    is_another_change,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.rounds import better_of_both
from piezo_hysteresis.discovery.selection.screen import Screen, ScreeningScore
from piezo_hysteresis.discovery.verdict.changes import changes_of
from piezo_hysteresis.discovery.verdict.naming import summary_of
from piezo_hysteresis.discovery.verdict.verdict import HeldOut, Number, Unexplained, Verdict
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.models import add_effect, described, named, shifted
from piezo_hysteresis.records import Record, RecordInfo
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


DT = 1e-3
MODEL = named('bouc_wen_mode')
VALUES = {**MODEL.defaults(), 'natural_frequency': 160.0, 'damping_ratio': 0.012}


def multisine(values: dict[str, float]) -> Record:
    """Return a multisine up to 300 Hz."""
    t = DT * np.arange(2000)
    phases = np.random.default_rng(1).uniform(0.0, 6.3, 60)
    u = sum(0.02 * np.sin(2 * np.pi * 5.0 * (k + 1) * t + each) for k, each in enumerate(phases))
    y = MODEL.respond(np.asarray(u), MODEL.pack(values), DT)
    return Record('multisine', DT, np.asarray(u), y, info=RecordInfo(excitation='multisine'))


@pytest.mark.parametrize('factor', [0.61, 0.8125, 1.25, 1.7])
def test_the_screening_finds_how_far_a_mode_moved(factor: float) -> None:
    record = multisine(VALUES | {'natural_frequency': factor * 160.0})
    views = split([record]).training
    before = evaluated_on(ModelSpec(MODEL, dict(VALUES)), views)
    candidate = shifted(MODEL, VALUES, MODEL.free_names)
    best = Screen(before, views, ()).score(candidate).starts[0]
    assert best['natural_frequency'] / 160.0 == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize(('share', 'none'), [(1.003, True), (0.2, False), (0.8, False)])
def test_a_second_mode_that_carries_everything_is_the_first_one(share: float, none: bool) -> None:
    effect = next(e for e in described('resonance') if e.variant == 'mode_pair')
    found = add_effect(MODEL, effect)
    values = found.values(VALUES, {**found.starts[0], 'resonance_frequency': 130.0})
    spec = ModelSpec(MODEL, dict(VALUES)).with_candidate(
        found, values | {'resonance_share': share}
    )
    assert is_another_change(CandidateFit(spec.model, spec.values, spec.added)) == none


def test_a_growing_gain_is_no_decay() -> None:
    effect = next(e for e in described('gain_decay') if e.variant == 'gain_decay')
    found = add_effect(MODEL, effect)
    assert next(q.low for q in found.model.parameters if q.name == 'gain_loss') == 0.0
    assert all(start['gain_loss'] > 0.0 for start in found.starts)


def test_changes_are_stated_in_units_of_users_and_the_gain_once() -> None:
    start = CandidateFit(MODEL, dict(VALUES))
    units = {q.name: q.unit for q in MODEL.parameters}
    after = {
        name: (1.03 if units[name].startswith('m') else 1.0) * value
        for name, value in VALUES.items()
        if name in MODEL.free_names
    } | {'natural_frequency': 130.0}
    numbers = {name: Number(v, 1e-6 * abs(v), units[name]) for name, v in after.items()}
    changes = changes_of(numbers, start, start, [multisine(VALUES)])
    moved = 'natural_frequency 160 Hz to 130 Hz'
    assert changes == (f'{moved} ± 130 µHz', 'gain +3 %')

    # a time limit leaves no standard deviations, and the end of a range is no value
    bare = {name: Number(number.value, None, number.unit) for name, number in numbers.items()}
    assert changes_of(bare, start, start, [multisine(VALUES)]) == (moved, 'gain +3 %')
    low = next(q.low for q in MODEL.parameters if q.name == 'natural_frequency')
    ended = bare | {'natural_frequency': Number(low, None, 'Hz')}
    assert changes_of(ended, start, start, [multisine(VALUES)]) == ('gain +3 %',)


def test_changes_without_standard_deviations_stand_in_the_order_of_their_evidence() -> None:
    """A time limit leaves none: creep that hardly shows moved far, the mode a little."""
    model = MODEL.with_block(named_block('creep'))
    values = {**VALUES, 'creep_share': 1e-4, 'creep_time': 3.0}
    start = CandidateFit(model, values)
    units = {q.name: q.unit for q in model.parameters}
    after = {'natural_frequency': 140.0, 'creep_time': 30.0, 'creep_share': 2e-4}
    numbers = {name: Number(after.get(name, v), None, units[name]) for name, v in values.items()}
    first, *others = changes_of(numbers, start, start, [multisine(VALUES)])
    assert first == 'natural_frequency 160 Hz to 140 Hz'
    assert {each.partition(' ')[0] for each in others} == {'creep_time', 'creep_share'}


@pytest.mark.parametrize('shape', [1.15, 0.8])
def test_a_wider_loop_is_one_number_and_not_its_parameters(shape: float) -> None:
    start = CandidateFit(MODEL, dict(VALUES))
    units = {q.name: q.unit for q in MODEL.parameters}
    after = {**VALUES, 'A': shape * VALUES['A']}  # of the part that is no line
    numbers = {
        name: Number(after[name], 1e-6 * abs(after[name]), units[name])
        for name in MODEL.free_names
    }
    u = 2.0 * np.sin(2.0 * np.pi * 2.0 * DT * np.arange(round(1.0 / DT)))
    slow = Record('slow', DT, u, np.zeros(u.size))
    (loop, *_) = changes_of(numbers, start, start, [slow])
    assert loop.startswith('loop width +' if shape > 1.0 else 'loop width -')


@pytest.mark.parametrize('held', [True, False])
def test_nothing_missing_beside_a_gap_says_that_the_gap_was_known(held: bool) -> None:
    verdict = Verdict(
        'model.yaml', 0, 5e-9, HeldOut(48e-9, 48e-9, 9.63, 9.63), (), 'none',
        Unexplained(False, ''), (), (), {'training': ['a'], 'held_out': ['b']}, 1.0,
        held_baseline=held,
    )  # fmt: skip
    known = 'floors, is one that it was known to leave.' in summary_of(verdict)
    assert known == held
    assert '9.63 noise floors' in summary_of(verdict)
