"""A baseline whose mode or gain has changed: the change is sought before a new effect."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
    is_another_change,
)
from piezo_hysteresis.discovery.selection.screen import Screen
from piezo_hysteresis.discovery.verdict.naming import changes_of, summary_of
from piezo_hysteresis.discovery.verdict.verdict import HeldOut, Number, Unexplained, Verdict
from piezo_hysteresis.models import add_effect, described, named, shifted
from piezo_hysteresis.records import Record, RecordInfo

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
    changes = changes_of(numbers, start, [multisine(VALUES)])
    assert changes == ('natural_frequency 160 Hz to 130 Hz', 'gain +3 %')

    # a time limit leaves no standard deviations, and the end of a range is no value
    bare = {name: Number(number.value, None, number.unit) for name, number in numbers.items()}
    assert changes_of(bare, start, [multisine(VALUES)]) == changes
    low = next(q.low for q in MODEL.parameters if q.name == 'natural_frequency')
    ended = bare | {'natural_frequency': Number(low, None, 'Hz')}
    assert changes_of(ended, start, [multisine(VALUES)]) == ('gain +3 %',)


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
