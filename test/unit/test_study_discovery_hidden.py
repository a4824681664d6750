"""The code that adds effects to measured records, and the exam of the results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.discovery.verdict.verdict import (
    Alternative,
    HeldOut,
    NamedEffect,
    Unexplained,
    Verdict,
)
from piezo_hysteresis.models import EFFECT_NAMES
from piezo_hysteresis.records import Record, write_csv
from studies.worlds import foreign_world as foreign
from studies.worlds.hidden import CASES, HIDDEN, Row, compared, exam, hide, noisy

DT, STROKE = 1e-3, 2e-5


def measured() -> Record:
    t = DT * np.arange(4000)
    return Record('one', DT, np.sin(2 * np.pi * t), 0.5 * STROKE * np.sin(2 * np.pi * t) + 3e-5)


@pytest.mark.parametrize('kind', list(HIDDEN))
def test_each_kind_changes_the_displacement_alone_and_by_its_size(kind: str) -> None:
    before = measured()
    small, large = (hide([before], kind, size, CASES[0])[0] for size in (0.25, 1.0))
    changed = [float(np.std(r.displacement - before.displacement)) for r in (small, large)]
    assert np.array_equal(large.voltage, before.voltage)
    if kind == 'nothing':
        assert changed == [0.0, 0.0]
        return
    assert HIDDEN[kind][1] in EFFECT_NAMES
    assert changed[0] == pytest.approx(0.25 * changed[1], rel=0.1)
    assert 1e-4 * STROKE < changed[1] < 0.2 * STROKE


def test_records_taken_again_have_noise_of_their_own() -> None:
    before = measured()
    one, other = (noisy([before], 1e-8, (seed,))[0] for seed in (1, 2))
    assert np.array_equal(one.voltage, before.voltage)
    for record in (one, other):
        assert np.std(record.displacement - before.displacement) == pytest.approx(1e-8, rel=0.1)
    apart = np.std(one.displacement - other.displacement)
    assert apart == pytest.approx(np.sqrt(2.0) * 1e-8, rel=0.1)


def test_evaluated_records_begin_where_their_reference_ends(tmp_path: Path) -> None:
    whole = measured()
    case = replace(CASES[0], fitted='one.csv', evaluated=('one.csv',), parted=0.5 * whole.duration)
    write_csv(tmp_path / 'one.csv', whole)
    known, (after,), within = compared(case, 'classical', tmp_path, 'parts', (1,), 1)
    assert known.discrepancy is not None
    (trace,) = known.discrepancy.traces
    both = np.concatenate([trace.voltage, after.voltage])
    assert both == pytest.approx(whole.voltage)
    assert within.slow == pytest.approx(after.dt * len(after))
    known, (again,), within = compared(case, 'classical', tmp_path, 'repeated', (1,), 1)
    assert np.std(again.displacement - whole.displacement) == pytest.approx(case.noise, rel=0.1)
    assert within is case


def verdict(word: str, names: tuple[str, ...], after: float) -> Verdict:
    effects = tuple(
        NamedEffect(n, '', 0.9, 1e-6, 2e-7, after, {}, (Alternative('creep', 0.2),), ())
        for n in names
    )
    gap = HeldOut(2e-7, after, 4.0, 2.0)
    return Verdict(
        'classical', 0, 5e-8, gap, effects, word, Unexplained(False, ''), (), (), {}, 1.0
    )


def test_the_exam_counts_what_was_right_wrong_and_taken_out() -> None:
    rows = [
        Row('P-885', 'classical', 'nothing', 0.5, verdict('none', (), 1e-7), 1e-7, 3.0),
        Row(
            'P-885', 'classical', 'lag', 0.5, verdict('named', ('amplifier_lag',), 1e-7), 1e-7, 3.0
        ),
        Row('P-885', 'classical', 'tone', 0.5, verdict('named', ('creep',), 1.5e-7), 1e-7, 3.0),
        Row('P-885', 'classical', 'drift', 0.5, verdict('unknown', (), 1.5e-7), 1e-7, 3.0),
    ]
    found = exam('hidden', rows, 7)
    assert found.counts == {
        'first': (1, 3), 'class': (1, 3), 'wrong': (1, 3), 'class_without': (1, 3),
        'none': (1, 1), 'held_out': (1, 3),
    }  # fmt: skip
    assert 'right effect first: 1 of 3' in found.text()
    assert found.rows[1]['reported'] == 'amplifier_lag 0.90 (or creep)'
    assert [row['right'] for row in found.rows] == [True, True, False, False]


@pytest.mark.component
@pytest.mark.parametrize('name', list(foreign.WORLDS))
def test_foreign_worlds_answer_metres_from_rest_and_lag_behind(name: str) -> None:
    (record,) = foreign.recorded(foreign.WORLDS[name], [(1.0, 5.0)], 1.0, np.random.default_rng(1))
    assert abs(record.displacement[0]) < 5 * foreign.NOISE * foreign.STROKE
    last = record.displacement[-400:]
    assert 0.5 * foreign.STROKE < 0.5 * float(np.ptp(last)) < 2.0 * foreign.STROKE
    # the area of the loop is positive: the displacement comes after the voltage
    loop = float(np.sum(record.voltage[-400:] * np.gradient(last)))
    assert loop > 0.01 * foreign.STROKE
    again = foreign.recorded(foreign.WORLDS[name], [(1.0, 5.0)], 1.0, np.random.default_rng(1))[0]
    assert np.array_equal(again.displacement, record.displacement)
