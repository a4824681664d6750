"""What only held-out records show can neither be named nor passed over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import FIT_SAMPLES, split
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, evaluated_on
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.workflow import discover
from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo

RATE, NOISE = 1000.0, 2e-8
MODEL = named('linear_mode')
TRUE = {
    **MODEL.defaults(),
    'A1': 1e-5,
    'natural_frequency': 90.0,
    'damping_ratio': 0.05,
    'offset': 0.0,
}


def record(frequency: int, seed: int, seconds: float = 2.0, late: float = 0.0) -> Record:
    """Return what the model answers; its last eighth is shifted by `late` [m].

    That is half of what is held out: all of it would be another zero.
    """
    t = np.arange(round(seconds * RATE)) / RATE
    u = np.sin(2 * np.pi * frequency * t)
    y = MODEL.respond(u, MODEL.pack(TRUE), 1.0 / RATE, state=MODEL.initial_state(1.0 / RATE))
    y = y + NOISE * np.random.default_rng(seed).normal(size=t.size)
    y[-t.size // 8 :] += late
    kind = 'multisine' if late else 'sine'
    info = RecordInfo(excitation=kind, frequency=0.0 if late else float(frequency), amplitude=1.0)
    return Record(f'{kind}_{frequency}Hz', 1.0 / RATE, u, y, info=info)


@pytest.mark.slow
def test_a_gap_that_only_held_out_records_show_is_unknown() -> None:
    fine = [record(f, k) for k, f in enumerate((1, 2, 4, 5, 8, 10))]
    late = record(3, 9, late=5e-7)
    found = discover([*fine, late], MODEL)
    assert found.final.rms < 1.1 * found.floor
    assert found.verdict.held_out.after_in_floors > 3.0
    assert found.verdict.verdict == 'unknown'
    assert late.name in found.verdict.unexplained.description
    sound = discover([*fine, record(3, 9)], MODEL)
    assert sound.verdict.verdict == 'none'


@pytest.mark.slow
def test_values_that_training_determines_poorly_are_no_missing_effect() -> None:
    fine = [record(f, k) for k, f in enumerate((1, 2, 4, 5, 8, 10))]
    t = np.arange(2000) / RATE
    # the mode is driven in the last quarter alone, which is held out
    u = np.sin(2 * np.pi * np.where(t < 1.5, 3.0, 90.0) * t)
    y = MODEL.respond(u, MODEL.pack(TRUE), 1.0 / RATE, state=MODEL.initial_state(1.0 / RATE))
    y = y + NOISE * np.random.default_rng(9).normal(size=t.size)
    into_mode = Record('late', 1.0 / RATE, u, y, info=RecordInfo(excitation='multisine'))
    found = discover([*fine, into_mode], MODEL).verdict
    assert found.held_out.after_in_floors > 1.5
    assert found.verdict == 'none'
    assert not found.unexplained.significant
    assert 'damping_ratio' in found.summary


def test_a_chirp_trains_whole_where_sines_are_held_out() -> None:
    sines = [record(f, k) for k, f in enumerate((1, 2, 4, 5, 8, 10))]
    sine = record(3, 9)
    chirp = Record('up', 1.0 / RATE, sine.voltage, sine.displacement,
                   info=RecordInfo(excitation='chirp'))  # fmt: skip
    data = split([*sines, chirp])
    assert {v.name: v.measured.size for v in data.training}['up'] == 2000
    assert {v.name for v in data.held_out} <= {r.name for r in sines}
    # alone it gives its last quarter
    alone = split([chirp])
    assert [v.measured.size for v in (*alone.training, *alone.held_out)] == [1500, 500]


@pytest.mark.parametrize(
    ('added', 'cut'),
    [
        ((), set()),
        (((0.1, 1.0, 20.0),), {'sine_0.1Hz'}),  # creep shows in it alone
        (((400.0, 1.0, 2.0),), {'sine_400Hz'}),
        (((5.0, 3.0, 2.0),), {'sine_5Hz'}),
        (((6.0, 1.0, 9.0),), {'sine_6Hz'}),
    ],
)
def test_the_end_of_an_extreme_record_is_held_out_where_none_is_like_it(
    added: tuple[tuple[float, float, float], ...], cut: set[str]
) -> None:
    def drive(frequency: float, size: float, seconds: float) -> Record:
        t = np.arange(round(seconds * RATE)) / RATE
        u = size * np.sin(2 * np.pi * frequency * t)
        y = 1e-5 * u + NOISE * np.random.default_rng(round(frequency)).normal(size=t.size)
        info = RecordInfo(excitation='sine', frequency=frequency, amplitude=size)
        return Record(f'sine_{frequency:g}Hz', 1.0 / RATE, u, y, info=info)

    usual = [drive(f, 1.0, 2.0) for f in (2.0, 3.0, 4.0, 7.0, 11.0, 13.0, 17.0)]
    data = split([*usual, *(drive(*each) for each in added)])
    trained = {v.name: v for v in data.training}
    held_out = {v.name: v for v in data.held_out}
    assert trained.keys() & held_out.keys() == cut
    for name in cut:
        # the parts do not overlap
        assert trained[name].first + trained[name].measured.size <= held_out[name].first


def test_long_records_are_fitted_in_part() -> None:
    many = [record(f, f, seconds=20.0) for f in (2, 3, 4, 5, 7, 9)]
    data = split(many)
    assert sum(v.voltage.size for v in data.training) <= 1.1 * FIT_SAMPLES
    assert min(v.measured.size for v in data.training) >= 2000


def test_brief_fits_share_the_unknown_initial_states() -> None:
    moving = [replace(v, begins=RecordStart('estimate')) for v in split([record(3, 1)]).training]
    evaluator = FreeEvaluator(replace(split([record(3, 1)]), training=tuple(moving)), 0, 1)
    before = evaluator.evaluated(ModelSpec(MODEL, dict(TRUE)))
    sharing = evaluator.with_shared_starts(before)
    assert all(view.shared is not None for view in (*sharing.short, *sharing.screened))
    assert all(view.shared is None for view in sharing.views)
    again, known = (evaluated_on(before, views) for views in (sharing.short, evaluator.short))
    assert again.square == pytest.approx(known.square, rel=1e-6)
