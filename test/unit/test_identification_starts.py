"""Starts of fits and of records: unseen parameters, initial states, held levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis import models
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit_data import FitData, whole
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.initial_conditions import start_hypotheses
from piezo_hysteresis.identification.initial_conditions.record_start import (
    SETTLED,
    RecordStart,
    cycle_of,
    first_guess,
    lead_in,
)
from piezo_hysteresis.identification.initial_conditions.revision import (
    RecordAssumptions,
    estimate_nuisances,
)
from piezo_hysteresis.identification.noise import bad_samples
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.identification.simulate import simulate as simulate_records
from piezo_hysteresis.identification.validate import validate
from piezo_hysteresis.models import ModelFile, name_of, named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_sim.sweep import grid, simulate
from studies.ordinary_stage import Stage, drawn
from studies.worlds.scans import drawn as drawn_scan

DT = 1e-3


def sines(preset: str, *frequencies: float, cut: int = 0) -> list[Record]:
    """Return sines of 3 s, the first of them without its first `cut` samples."""
    specs = grid('sine', list(frequencies), [1.0], {'duration': 3.0, 'warm_up': 1.0})
    first, *others = simulate(preset, specs, {}, 0, None)
    return [first.section(cut, len(first)) if cut else first, *others]


@pytest.mark.component
@pytest.mark.parametrize(
    ('preset', 'model', 'frequencies', 'cut'),
    [
        # what this model misses makes a level before the first record do as well as rest
        ('fdk_pzba_00030', 'bouc_wen_mode', (1, 5, 10, 14, 18, 22, 23, 24, 35, 50), 0),
        ('generic_bouc_wen', 'prandtl_ishlinskii', (1, 5), 137),
    ],
)
def test_the_reported_error_is_that_of_a_free_run(
    preset: str, model: str, frequencies: tuple[float, ...], cut: int
) -> None:
    records = sines(preset, *frequencies, cut=cut)
    found = identify(records, models.named(model))
    validation = validate(records, found)
    for record, run, row in zip(
        records, simulate_records(found, records), found.records, strict=True
    ):
        error = (record.displacement - run)[record.warm_up_samples :]
        assert np.sqrt(np.mean(error**2)) == row.free_run_rms
        assert validation.simulated[record.name].tobytes() == run.tobytes()
    assert validation.records == found.records


def test_a_part_that_closes_by_chance_does_not_begin_settled() -> None:
    """Of 2500 samples the first 2000 end where they begin and pass for a cycle; all do not."""
    t = np.arange(2500) / 1000.0
    voltage = 1.0 + np.minimum(t / 0.2, 1.0) ** 2 * np.sin(2 * np.pi * 31.0 * t)
    model = models.named('classical')
    cycle = voltage[:2000]
    led = np.concatenate([cycle, cycle, cycle, voltage])
    y = model.respond(led, model.pack(model.defaults()), 1e-3)[6000:]
    record = Record('a', 1e-3, voltage, y)
    assert cycle_of(record.section(0, 2000))
    assert not cycle_of(record)
    target = whole(record, begins=RecordStart('estimate'))
    end = target.origin + 2000
    part = replace(target, voltage=target.voltage[:end], measured=target.measured[:2000])
    (seen,) = estimate_nuisances(
        model, model.defaults(), 0.0, [part], [record], RecordAssumptions(), alone=True
    )
    assert seen.begins.kind != 'settled'


def test_a_sample_that_depends_on_the_input_before_the_record_has_no_error() -> None:
    """Three samples of 160 µm made the known discrepancy of a file nine times too large."""
    k = np.arange(-800, 800)
    voltage, zero = 1.8 + 1.8 * np.sin(2.0 * np.pi * k / 200.0), 4e-6
    model = named('classical')
    packed = model.pack(model.defaults())
    y = model.respond(voltage, packed, DT)
    early = 2  # samples by which the displacement is read later than the response
    record = Record('a', DT, voltage[800:], y[800 - early - 1 : -early - 1] + zero)
    target = replace(whole(record, begins=RecordStart('estimate')), own_zero=True)
    found = Prediction(model, packed, target, -early * DT)
    step = float(np.max(np.abs(np.diff(y))))
    assert np.max(np.abs(found.error)) < 1e-3 * step
    np.testing.assert_array_equal(found.displacement[: early + 1], record.displacement[:3])
    assert found.zero == pytest.approx(zero, rel=1e-3)


@pytest.mark.parametrize('begin', ['step', 'settled', 'ring'])
def test_the_first_period_shows_how_a_periodic_record_begins(begin: str) -> None:
    """A transient is neither the steady cycle nor a row of spikes; a spike in it is one."""
    period, noise = 400, 2e-8 * np.random.default_rng(4).standard_normal(2000)
    k = np.arange(2000)
    voltage = 0.5 + np.sin(2 * np.pi * k / period)
    ring = np.exp(-k / 30.0) * np.cos(2 * np.pi * k / 11.0)
    transient = {'step': np.exp(-k / 60.0), 'settled': 0.0 * ring, 'ring': ring}[begin]
    y = 1e-5 * voltage + 4e-6 * transient + noise
    y[[310, 900]] += 5e-6
    record = Record('a', 1e-3, voltage, y)
    guess = first_guess(record)
    assert guess.kind == ('settled' if begin == 'settled' else 'estimate')
    assert np.flatnonzero(bad_samples(record)).tolist() == [310, 900]


def test_a_loop_around_an_offset_voltage_is_led_into_its_steady_cycle() -> None:
    """The effect of the virgin state halves per cycle; three cycles left a drift of 1 um."""
    model = models.named('classical')
    values = {**model.defaults(), 'A1': 28e-6, 'A': 16e-6, 'beta': 0.124, 'gamma': -0.015}
    t = 5e-3 * np.arange(800)
    voltage = 1.8 + 1.8 * np.sin(2 * np.pi * t)
    record = Record('r', 5e-3, voltage, 1e-5 * voltage)
    before = lead_in(record, SETTLED)
    y = model.respond(np.concatenate([before, voltage]), model.pack(values), 5e-3)
    cycles = y[before.size :].reshape(4, 200)
    assert np.max(np.abs(cycles[0] - cycles[3])) < 1e-3 * np.ptp(cycles)


@pytest.mark.parametrize(('blocks', 'searched'), [((), False), (('creep',), True)])
def test_initial_conditions_are_searched_only_where_their_effect_lasts(
    blocks: tuple[str, ...], searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The effect of the voltage before a record decays in a few cycles of a loop, not in creep."""
    model = models.named('classical')
    for name in blocks:
        model = model.with_block(named_block(name))
    slow = {'creep_share': 0.1, 'creep_time': 1e3} if blocks else {}
    values = {**model.defaults(), **slow}
    voltage = np.sin(2 * np.pi * 5.0 * DT * np.arange(8000))
    y = model.respond(voltage, model.pack(values), DT)
    record = Record('a', DT, voltage, 1.03 * y)  # an error that lasts over the record
    evaluated: list[FitData] = []

    class Counted(Prediction):
        def __init__(self, model: Any, packed: Any, target: FitData, *rest: Any) -> None:
            evaluated.append(target)
            super().__init__(model, packed, target, *rest)

    monkeypatch.setattr(start_hypotheses, 'Prediction', Counted)
    (seen,) = estimate_nuisances(
        model, values, 0.0, [whole(record)], [record], RecordAssumptions(), alone=True
    )
    assert seen.begins.kind == 'step'
    assert (len(evaluated) > 10) is searched


@pytest.mark.parametrize('kind', ['rest', 'settled', 'settled slow'])
def test_a_lead_in_has_few_samples_at_any_rate(kind: str) -> None:
    dt, frequency = 1e-5, 0.5 if 'slow' in kind else 50.0
    u = 1.0 + np.sin(2 * np.pi * frequency * dt * np.arange(round(2.0 / frequency / dt)))
    record = Record('fast', dt, u, u, info=RecordInfo(frequency=frequency))
    before = lead_in(record, RecordStart(kind.split()[0]))
    assert before.size <= 50_000
    assert abs(before[-1] - u[0]) < 0.01
    # the last samples have the rate of the record
    assert np.max(np.abs(np.diff(before[-2000:]))) < 2.0 * np.max(np.abs(np.diff(u)))


def test_a_part_of_a_record_keeps_a_start_that_only_the_whole_record_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The fitted 70 % of one settled cycle lack the cycle that the start repeats."""
    monkeypatch.setattr(start_hypotheses, '_SMALL_PART', 1)  # starts are compared on a part
    u = 50.0 + 45.0 * np.cos(2 * np.pi * np.arange(20_000) / 20_000.0 - 0.3)
    model = models.named('prandtl_ishlinskii').hold(pi_range=95.0)
    packed = model.pack({**model.defaults(), 'w0': 1e-7, 'w5': 4e-8})
    y = model.respond(np.tile(u, 2), packed, DT)[u.size :]
    y = y + 5e-9 * np.random.default_rng(1).standard_normal(u.size)
    record = Record('slow', DT, u, y)
    target = whole(record, begins=SETTLED)
    part = replace(
        target, voltage=target.voltage[: target.origin + 14_000], measured=target.measured[:14_000]
    )
    assert cycle_of(record)
    assert not cycle_of(record.section(0, 14_000))
    values = {**dict(zip(model.parameter_names, packed.tolist(), strict=True)), 'w0': 0.97e-7}
    (seen,) = estimate_nuisances(model, values, 0.0, [part], [record], RecordAssumptions())
    assert seen.begins == SETTLED


SEED = 504  # steps that end beyond every later level: plays forget what was before them
SIZE = 20_000


def steps(x: FloatArray) -> FloatArray:
    rng = np.random.default_rng((9, SEED))
    return 0.1 + 0.8 * np.repeat(rng.uniform(0.0, 1.0, 10), x.size // 10)


def chirp(x: FloatArray) -> FloatArray:
    stage = drawn(SEED)
    time = x * SIZE / stage.rate
    return 0.5 + 0.3 * np.sin(2 * np.pi * (2 * stage.rate / SIZE + 0.2 * stage.mode * x) * time)


def recorded(waveform: Callable[[FloatArray], FloatArray]) -> ph.Record:
    draw, name = drawn(SEED), waveform.__name__
    voltage = draw.low + draw.span * np.clip(waveform(np.arange(SIZE) / SIZE), 0.0, 1.0)
    stage = Stage(draw, SEED + len(name))
    stage.respond(np.linspace(draw.middle, voltage[0], 2000))
    return ph.Record(name, 1 / draw.rate, voltage, stage.respond(voltage))


@pytest.mark.slow
def test_what_a_fit_promises_a_run_keeps() -> None:
    found = ph.identify([recorded(steps), recorded(chirp)], 'prandtl_ishlinskii+mode', workers=2)
    assert found.fit is not None
    assert any(target.begins.held for target in found.fit.targets)
    assert max(row.nrmse_percent for row in found.records) < 3.0  # 18 with free levels
    for row in found.records:
        left = found.fit.residuals[row.record]
        assert row.free_run_rms == pytest.approx(float(np.sqrt(np.mean(left**2))), rel=0.1)


@pytest.mark.component
@pytest.mark.parametrize('name', ['classical', 'bouc_wen_mode'])
def test_a_single_scan_that_begins_at_0_v_may_begin_in_motion(name: str) -> None:
    """A fit from rest adapts to the wrong start, which then looks right (.133 µm of .011)."""
    scans = drawn_scan('hysteresis', 1, 9).scans
    found = ph.identify(scans, name, workers=2)
    assert max(row.free_run_rms for row in found.records) < 0.02e-6
    assert {row.start.split()[0] for row in found.records} == {'estimate'}


LOOP = {'A1': 140e-6, 'A': 60e-6, 'beta': 1.2, 'gamma': 0.3, 'offset': 3e-6}


def identified(model: str, rate: float, **more: float) -> Identification:
    """Return `bouc_wen_mode` identified from records of another chain."""
    chain, rng = named(model), np.random.default_rng(1)
    packed = chain.pack({**chain.defaults(), **LOOP, **more})
    records = []
    for amplitude in (0.4, 1.0):
        u = amplitude * np.sin(2 * np.pi * 5.0 * np.arange(1200) / rate)
        y = chain.respond(u, packed, 1.0 / rate) + 2e-8 * rng.standard_normal(u.size)
        records.append(Record(f'{amplitude:g} V', 1.0 / rate, u, y))
    return identify(records, named('bouc_wen_mode'), count=2)


@pytest.mark.component
def test_a_mode_that_no_record_shows_is_omitted_and_reported() -> None:
    found = identified('classical', 2000.0)
    assert found.chain.name == 'classical'
    assert 'natural_frequency' not in found.values
    assert found.values['A1'] == pytest.approx(LOOP['A1'], rel=0.01)
    assert all(row.free_run_rms < 2.2e-8 for row in found.records)
    (words,) = found.left_out
    assert words in found.warnings
    assert 'the block mode, which is removed' in words
    saved = ModelFile.parse(found.model.text())
    assert saved.provenance.notes['left_out'] == words


def test_a_mode_that_records_show_stays() -> None:
    found = identified('bouc_wen_mode', 1000.0, natural_frequency=62.0, damping_ratio=0.03)
    assert found.left_out == ()
    assert found.values['natural_frequency'] == pytest.approx(62.0, rel=0.01)


@pytest.mark.component
def test_of_values_that_only_do_something_together_one_is_held() -> None:
    found = identified('classical+amplifier_lag', 1000.0, lag_time=0.02)
    (words,) = found.left_out
    assert 'is held at' in words
    (held,) = set(found.chain.held) - {'A0'}
    assert ModelFile.parse(found.model.text()).model.held[held] == found.values[held]
    late = found.values['damping_ratio'] / (np.pi * found.values['natural_frequency'])
    assert late + found.sampling_offset == pytest.approx(0.02, rel=0.3)


def test_a_chain_is_called_what_holds_the_same() -> None:
    for name in ('classical', 'modified', 'bouc_wen_mode', 'prandtl_ishlinskii+creep'):
        assert name_of(named(name)) == name
    bare = named('linear_mode')
    for block in bare.blocks[1:]:
        bare = bare.without(block)
    assert name_of(bare) == ''
