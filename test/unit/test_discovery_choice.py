"""The automatic choice keeps what held-out data confirm and leaves the rest out."""

from __future__ import annotations

from dataclasses import fields
from math import inf
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from piezo_hysteresis.discovery import choose as rules
from piezo_hysteresis.discovery.choose import (
    CHOICE,
    ChoicePolicy,
    ForwardSelection,
    Trial,
    TriedModel,
    choose_model,
    climbed,
    simplest_first,
)
from piezo_hysteresis.discovery.selection.policy import rows
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import add_effect, described, named
from piezo_hysteresis.models.named import LADDER, MEMORIES
from piezo_hysteresis.records import Record

DT = 1e-3
VALUES = {'A1': 1.6e-4, 'A': 3e-5, 'A0': -4e-6, 'beta': 1.2, 'gamma': 0.2, 'offset': 2e-6}


def record(effect: str | None, noise: float = 2e-8) -> Record:
    """Simulate two tones, with one effect or none besides the hysteresis."""
    model, values = named('modified'), dict(VALUES)
    if effect is not None:
        candidate = add_effect(model, described(effect)[0])
        model, values = candidate.model, candidate.values(values, candidate.starts[0])
        if effect == 'creep':
            values |= {'creep_share': 0.15, 'creep_time': 0.4}
    time = np.arange(4000) * DT
    voltage = 0.7 * np.sin(2 * np.pi * 3 * time) + 0.3 * np.sin(2 * np.pi * 7.3 * time)
    clean = model.respond(voltage, model.pack(values), DT)
    clean = np.concatenate([[values['offset']], clean[:-1]])  # measured before the voltage acts
    scatter = noise * np.random.default_rng(4).standard_normal(time.size)
    return Record('a', DT, voltage, clean + scatter)


@pytest.mark.slow
def test_creep_is_found_where_it_is() -> None:
    choice = choose_model([record('creep')])
    by_name = {step.name: step for step in choice.steps if step.memory == 'modified'}
    assert by_name['creep'].kept
    assert by_name['creep'].held_out_rms == pytest.approx(2e-8, rel=0.1)
    assert by_name['modified'].held_out_rms > 10 * by_name['creep'].held_out_rms
    assert choice.model.block_names == ('bouc_wen_exact', 'creep', 'offset')
    assert choice.start['creep_share'] == pytest.approx(0.15, rel=0.05)
    assert choice.start['creep_time'] == pytest.approx(0.4, rel=0.05)


@pytest.mark.component
def test_nothing_is_added_where_nothing_is_missing() -> None:
    tried: list[str] = []
    choice = choose_model([record(None)], lambda fraction, words: tried.append(words))
    plain = [step for step in choice.steps if step.memory == 'modified']
    assert [step.name for step in plain if step.kept] == ['modified']
    assert choice.model.name == 'modified'
    assert tried == [name for memory in MEMORIES for name in (memory, *LADDER)]


@pytest.mark.component
def test_an_effect_that_promises_nothing_is_not_fitted_to_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    selection = ForwardSelection([record(None)], RecordAssumptions())
    before = selection.memory('modified')
    monkeypatch.delattr(ForwardSelection, '_polished')
    for name in ('amplifier_lag', 'creep'):
        tried = selection.larger(before, name)
        assert tried is not None
        assert not tried.improves(before)
        assert tried.trained == pytest.approx(before.trained, rel=0.01)


def test_of_variants_that_fit_alike_the_smallest_comes_first() -> None:
    def trial(name: str, count: int, cost: float) -> Any:
        return SimpleNamespace(name=name, added=('x',) * count), SimpleNamespace(cost=cost)

    tried = [trial('pair', 4, 0.99), trial('one', 2, 1.0), trial('other', 1, 1.2)]
    assert [each.name for each, _ in cast(Any, simplest_first(tried))] == ['one', 'pair', 'other']


class Rungs:
    """A selection whose mode lowers the held-out error only beside creep."""

    def memory(self, name: str) -> Any:
        return trial(1.0, 1.0, name)

    def larger(self, before: Any, name: str) -> Any:
        had = before.fit.model
        if name == 'creep':
            return trial(0.9 * before.trained, 0.8 * before.held_out, f'{had} creep')
        if name == 'mode':
            worse = 1.0 if 'creep' in had else 1.05
            return trial(0.8 * before.trained, worse * before.held_out, f'{had} mode')
        return trial(before.trained, before.held_out, f'{had} {name}')


def trial(trained: float, held_out: float, name: str) -> Any:
    return Trial(cast(Any, SimpleNamespace(model=name, free=())), trained, held_out, (), True)


def test_an_effect_that_was_rejected_is_tried_again_with_those_after_it() -> None:
    steps: list[TriedModel] = []
    best = climbed(cast(Any, Rungs()), 'plays', steps, lambda name, share: None)
    assert cast(Any, best.fit.model) == 'plays creep mode'
    assert [(s.name, s.kept) for s in steps if s.name in ('mode', 'creep')] == [
        ('mode', False),
        ('creep', True),
        ('mode', True),
    ]
    assert [s.name for s in steps].count('amplifier_lag') == 1  # it improved nothing


class Masked(Rungs):
    """A mode that explains 1 % of the squares, as long as creep is nine tenths of the error."""

    def larger(self, before: Any, name: str) -> Any:
        had = before.fit.model
        if name == 'creep':
            return trial(0.1 * before.trained, before.held_out, f'{had} creep')
        if name == 'mode':
            explained = min(0.006, 0.6 * before.trained**2)
            left = (before.trained**2 - explained) ** 0.5
            return trial(left, before.held_out, f'{had} mode')
        return trial(before.trained, before.held_out, f'{had} {name}')


def test_an_effect_that_a_larger_error_hid_is_tried_again() -> None:
    steps: list[TriedModel] = []
    best = climbed(cast(Any, Masked()), 'plays', steps, lambda name, share: None)
    assert cast(Any, best.fit.model) == 'plays creep mode'
    assert [s.kept for s in steps if s.name == 'mode'] == [False, True]
    assert [s.name for s in steps].count('amplifier_lag') == 1  # it explained nothing


def test_useless_records_are_refused() -> None:
    flat = Record('flat', DT, np.zeros(500), 1e-9 * np.arange(500.0))
    with pytest.raises(IdentificationError, match='constant'):
        choose_model([flat])


def one_tone(amplitudes: tuple[float, ...]) -> list[Record]:
    """Simulate an off-centre Bouc-Wen hysteresis, one sine of one amplitude to a record."""
    model, time = named('modified'), np.arange(2500) * DT
    records = []
    for k, amplitude in enumerate(amplitudes):
        voltage = amplitude * np.sin(2 * np.pi * 4 * time)
        clean = model.respond(voltage, model.pack(VALUES), DT)
        clean = np.concatenate([[VALUES['offset']], clean[:-1]])
        scatter = 2e-8 * np.random.default_rng(k).standard_normal(time.size)
        records.append(Record(f'r{k}', DT, voltage, clean + scatter))
    return records


@pytest.mark.slow
def test_one_amplitude_shows_no_inner_loop_and_one_curve() -> None:
    choice = choose_model(one_tone((1.0,)))
    assert 'prandtl_ishlinskii_fine' in choice.model.block_names
    several = choose_model(one_tone((1.0, 0.4)))
    assert 'bouc_wen_exact' in several.model.block_names


@pytest.mark.slow
def test_an_effect_that_the_records_do_not_determine_is_omitted() -> None:
    choice = choose_model(one_tone((1.0, 0.4)))
    kept = {step.name for step in choice.steps if step.kept and step.memory == 'modified'}
    assert kept == {'modified'}


@pytest.mark.parametrize(
    ('trained', 'held_out', 'better'),
    [
        ((1.0, 0.97), (1.0, 1.0), True),
        ((1.0, 0.99), (1.0, 0.97), True),
        ((1.0, 0.99), (1.0, 0.99), False),
        # held-out data veto, within 1 %
        ((1.0, 0.5), (1.0, 1.005), True),
        ((1.0, 0.5), (1.0, 1.02), False),
        ((1.0, inf), (1.0, inf), False),
    ],
)
def test_what_predicts_better(trained: Any, held_out: Any, better: bool) -> None:
    assert rules.predicts_better(trained, held_out) is better


def test_parameters_differ_from_none_together() -> None:
    std, apart = np.array([1.0, 1.0]), np.eye(2)
    assert rules.differs_from_none(np.empty(0), np.empty(0), np.empty((0, 0)))
    assert rules.differs_from_none(np.array([3.0, 3.0]), std, apart)
    assert not rules.differs_from_none(np.array([4.0, 1.0]), std, apart)
    # what is correlated counts once
    close = np.array([[1.0, 0.99], [0.99, 1.0]])
    assert not rules.differs_from_none(np.array([3.0, 3.0]), std, close)
    assert not rules.differs_from_none(np.array([9.0, 9.0]), np.array([1.0, inf]), apart)
    assert not rules.differs_from_none(np.array([9.0, 9.0]), np.array([1.0, 0.0]), apart)


@pytest.mark.parametrize(
    ('plays', 'one_amplitude', 'taken'),
    [(1.2, False, True), (1.3, False, False), (9.0, True, True)],
)
def test_plays_are_taken_where_they_cost_little(
    plays: float, one_amplitude: bool, taken: bool
) -> None:
    assert rules.plays_are_bearable(plays, 1.0, one_amplitude) is taken


def test_what_is_one_amplitude() -> None:
    voltage = np.array([-1.0, 3.0])
    assert rules.has_one_amplitude(voltage, np.array([3.0, -1.0, 2.8]))
    assert not rules.has_one_amplitude(voltage, np.array([3.0, -1.0, 2.0]))
    assert not rules.has_one_amplitude(voltage, np.empty(0))


def test_every_number_has_a_source() -> None:
    assert len(rows(CHOICE, CHOICE)) == len(fields(ChoicePolicy))
    assert all(source for *_, source in rows(CHOICE, CHOICE))


@pytest.mark.parametrize('samples', [2850, 2857])
def test_a_rung_is_evaluated_with_the_lead_in_of_its_fit(samples: int) -> None:
    """The fitted part passes for a cycle of its own; of the two records only one does."""
    t = np.arange(samples) / 1000.0
    u = 1.0 + np.minimum(t / 0.2, 1.0) ** 2 * np.sin(2 * np.pi * 31.0 * t)
    cut = round(0.7 * samples)
    model = named('classical')
    led = np.concatenate([u[:cut], u[:cut], u[:cut], u])
    moved = model.respond(led, model.pack(model.defaults()), 1e-3)[3 * cut :]
    moved = moved + 1e-9 * np.random.default_rng(0).standard_normal(samples)
    trial = ForwardSelection([Record('a', 1e-3, u, moved)], RecordAssumptions()).memory(
        'classical'
    )
    assert trial.trained < 1.1e-9
    assert trial.held_out < 1.1e-9
