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
from piezo_hysteresis.discovery.verdict.naming import changes_of
from piezo_hysteresis.discovery.verdict.verdict import Number
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
    said = changes_of(numbers, start, [multisine(VALUES)])
    assert said == ('natural_frequency 160 Hz to 130 Hz', 'gain +3 %')
