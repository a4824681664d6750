"""Repeated records say how much an unchanged actuator differs, and what a name may claim."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.selection.residual_model import expectation
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.models import Condition, Discrepancy, ModelFile, named
from piezo_hysteresis.models.repeated_records import (
    Support,
    kinds_of,
    support_of,
    surprise,
    together,
)
from piezo_hysteresis.records import Record

DT = 4e-3
TIME = np.arange(2000) * DT
SINE = {1: 1.0}


def row(**changed: Any) -> Condition:
    known = Condition(1.0, 1.0, 1e-5, 4e-7, harmonics={1: 3e-7}, phases={1: 0.2}, drive=SINE)
    return replace(known, **changed)


# --- the statistic ------------------------------------------------------------------------------


def test_records_of_one_kind_have_a_mean_and_a_scatter() -> None:
    phasors = 3e-7 * np.exp(0.2j) + 1e-8 * np.array([1.0, -1.0, 1j])
    rows = [row(harmonics={1: abs(a)}, phases={1: float(np.angle(a))}) for a in phasors]
    known = together(rows)
    assert known.records == 3
    assert known.harmonics[1] == pytest.approx(abs(phasors.mean()))
    assert known.scatter[1] == pytest.approx(np.sqrt(4 / 3) * np.std(phasors, ddof=1))
    assert together(rows[:1]) is rows[0]


@pytest.mark.parametrize(
    ('changed', 'kinds'),
    [
        ({'frequency': 1.06}, 1),
        ({'frequency': 1.3}, 2),
        ({'amplitude': 1.2}, 2),
        ({'drive': {1: 1.0, 3: 1 / 9}}, 2),
        ({'drive': {}}, 1),
    ],
)
def test_a_kind_has_one_drive(changed: dict[str, Any], kinds: int) -> None:
    assert len(kinds_of([row(), row(**changed)])) == kinds


def test_a_sweep_in_small_steps_is_no_repetition() -> None:
    sweep = [row(frequency=f) for f in 1.07 ** np.arange(12)]
    assert len(kinds_of(sweep)) == 12
    assert len(kinds_of([*sweep, row(frequency=1.0)])) == 12


def scattered(seed: int, count: int, size: float = 0.0) -> list[Condition]:
    draw = np.random.default_rng(seed)
    phasors = 3e-7 + 3e-8 * (draw.standard_normal(count) + 1j * draw.standard_normal(count))
    phasors[-1] += size
    return [row(harmonics={1: abs(a)}, phases={1: float(np.angle(a))}) for a in phasors]


def test_the_p_of_unchanged_records_is_not_below_its_level() -> None:
    chances = []
    for seed in range(400):
        *known, new = scattered(seed, 5)
        found = support_of([new], known)
        assert found is not None
        chances.append(found.chance)
    assert np.mean(np.array(chances) <= 0.2 + 1e-9) <= 0.2 + 3 * np.sqrt(0.2 * 0.8 / 400)
    assert min(chances) == pytest.approx(0.2)


def test_a_large_change_has_the_least_p_that_so_many_can_show() -> None:
    *known, new = scattered(1, 5, size=4e-7)
    found = support_of([new], known)
    assert found == Support(4, pytest.approx(0.2))  # type: ignore[arg-type]
    assert found is not None
    assert found.deviates
    assert 'probability above 0.8' in found.sentence(named=True)
    assert support_of([new], known[:1]) is None
    assert support_of([row(frequency=7.0)], known) is None
    assert surprise(new, known) > max(surprise(known[0], known[1:]), 3.0)
    other = support_of([new, row(frequency=7.0)], known)
    assert other is not None
    assert not other.complete


def test_one_record_expects_what_it_misses_once_more() -> None:
    view = replace(
        whole(Record('r', DT, np.sin(2 * np.pi * TIME), 5e-6 * np.sin(2 * np.pi * TIME))),
        noise=1e-9,
        frequency=1.0,
    )
    rough = row(rms=8e-7, harmonics={1: 3e-7, 3: 7e-7}, phases={1: 0.2, 3: 1.0})
    fine = replace(rough, rms=8e-9, harmonics={1: 3e-9, 3: 7e-9})
    once, twice = (
        expectation(view, Discrepancy(False, rows), 1e-5).total
        for rows in ((rough,), (rough, rough))
    )
    assert once > 5.0 * twice
    assert expectation(view, Discrepancy(False, (fine,)), 1e-5).total < 1e-4 * once


def test_rows_survive_a_file() -> None:
    known = Discrepancy(False, tuple(scattered(2, 3)))
    assert Discrepancy.parse(known.to_dict()).kinds[0].records == 3


# --- in a discovery -----------------------------------------------------------------------------


@cache
def run(seed: int, tone: float = 0.0, frequency: float = 1.0) -> Record:
    """Return a run of an actuator whose loop no play describes and whose width differs."""
    draw = np.random.default_rng(seed)
    angle = 2 * np.pi * frequency * (1.0 + 0.01 * draw.standard_normal()) * TIME
    wide = 1.0 + 0.2 * draw.standard_normal()
    y = np.sin(angle) + 0.1 * wide * np.tanh(6 * np.cos(angle)) + 0.05 * np.cos(9 * angle)
    y += 2e-4 * draw.standard_normal(TIME.size) + tone * np.sin(2 * np.pi * 31.7 * TIME)
    return Record(f'run_{seed}', DT, np.sin(angle), 1e-5 * y)


@cache
def model(count: int) -> ModelFile:
    return identify([run(k) for k in range(count)], named('prandtl_ishlinskii')).model


@pytest.mark.component
def test_unchanged_records_get_no_name_and_a_tone_gets_no_more_than_they_support() -> None:
    known = ModelFile.parse(model(4).text())
    assert known.discrepancy is not None
    assert [kind.records for kind in known.discrepancy.kinds] == [4]
    for seed in (11, 12, 13):
        assert discover(run(seed), known, recommend=False).verdict.verdict == 'none'
    found = discover(run(11, tone=0.2), known, recommend=False).verdict
    assert [each.name for each in found.effects] == ['mains_hum']
    assert found.repeats == {'records': 4, 'p_value': 0.2, 'attainable': 0.2}
    assert found.effects[0].probability <= 0.8
    assert 'Of 4 untouched repeats none deviates as far' in found.summary


@pytest.mark.component
def test_repeats_are_added_to_a_file_of_one_record() -> None:
    alone = discover(run(11), model(1), recommend=False).verdict
    assert alone.repeats is None
    assert 'does not show how much unchanged records differ' in alone.summary
    others = [run(k) for k in (0, 5, 6)]  # the first is the one of the file
    found = ph.discover(run(11), model(1), repeats=others, recommend=False).verdict
    assert found.verdict == 'none'
    assert found.repeats is not None
    assert found.repeats['records'] == 3
    with pytest.raises(IdentificationError, match='no two records of the same drive'):
        ph.discover(run(11), model(1), repeats=run(0))


@pytest.mark.component
def test_repeats_that_are_none_are_refused() -> None:
    again = replace(run(5), name='again')
    with pytest.raises(IdentificationError, match='run_5 and again are one run'):
        ph.discover(run(11), model(1), repeats=[run(5), again])
    other = replace(run(6), displacement=1e-3 * run(6).displacement)
    with pytest.raises(IdentificationError, match='another actuator, or another unit'):
        ph.discover(run(11), model(1), repeats=[run(5), other])
    fast = [run(k, frequency=4.0) for k in (5, 6)]
    found = ph.discover(run(11), model(1), repeats=fast, recommend=False).verdict
    assert 'The repeats are of other drives than these records' in found.summary


@pytest.mark.component
def test_records_at_another_frequency_alone_get_no_name() -> None:
    known = model(2)
    found = discover(run(11, tone=0.3, frequency=4.0), known, recommend=False).verdict
    assert found.verdict == 'unknown'
    assert found.suspects
    assert not found.effects
    assert 'against' in found.summary
    assert 'No effect is named from such records alone' in found.summary


@pytest.mark.component
def test_thousands_of_floors_that_nothing_explains_are_not_none() -> None:
    loud = discover(run(11), model(1), recommend=False).verdict
    assert loud.verdict == 'none'
    how = {'unexplained': 10.0}
    assert discover(run(11), model(1), policy=how, recommend=False).verdict.verdict == 'unknown'
    kept = discover(run(11), model(4), policy=how, recommend=False).verdict
    assert kept.verdict == 'none'
