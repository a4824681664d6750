"""The clock of records: guesses count from it, and one that the file does not say costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import part_of, split
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import FixedBaselineEvaluator
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.discovery.selection.screen import Screen, with_delayed_discrepancy
from piezo_hysteresis.discovery.selection.start import SearchOptions, held_data
from piezo_hysteresis.identification.fit_data import FitData, whole
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.model_discrepancy import residual_of
from piezo_hysteresis.identification.prediction import Prediction, predictions
from piezo_hysteresis.identification.simulate import JITTER, clock_about, clock_of
from piezo_hysteresis.identification.validate import compared
from piezo_hysteresis.models import (
    Condition,
    Discrepancy,
    Model,
    ModelFile,
    add_effect,
    described,
    named,
)
from piezo_hysteresis.models.modelfile import OFFSET_NOTE, OFFSET_STD_NOTE, Provenance
from piezo_hysteresis.records import Record, RecordInfo

DT, NOISE, MISSED = 2e-3, 1e-8, 1e-7
STILL = HELD.still_clock * DT
MODEL = named('classical')
VALUES = MODEL.defaults()


def driven(frequency: float) -> Record:
    """Return a drive from rest, its displacement not yet known."""
    u = np.sin(2 * np.pi * frequency * DT * np.arange(2000))
    info = RecordInfo(excitation='sine', frequency=frequency, amplitude=1.0, warm_up=0.5)
    return Record(f'{frequency:g} Hz', DT, u, 0.0 * u, info=info)


def measured(model: Model, values: dict[str, float], late: float, *, noise: float) -> list[Record]:
    """Return sines of an actuator whose displacement is sampled `late` [s]."""
    records = []
    for seed, frequency in enumerate((1.0, 5.0)):
        record = driven(frequency)
        view = whole(record)
        y = simulated(model, model.pack(values), view, late)[view.origin :]
        error = noise * np.random.default_rng(seed).standard_normal(y.size)
        records.append(replace(record, displacement=y + error))
    return records


def kept(late: float, std: float | None = None, model: Model = MODEL) -> ModelFile:
    """Return the file of a model that was identified with its clock so `late` [s]."""
    rms = float(np.hypot(MISSED, NOISE))
    missed = Discrepancy(False, (Condition(1.0, 1.0, 1e-4, rms, NOISE, {2: MISSED}),))
    known = {} if std is None else {OFFSET_STD_NOTE: std}
    notes = Provenance(notes={OFFSET_NOTE: late} | known)
    return ModelFile(model, model.defaults() | VALUES, provenance=notes, discrepancy=missed)


def held_by(
    known: ModelFile, records: list[Record]
) -> tuple[FixedBaselineEvaluator, CandidateFit]:
    """Return who judges beside a file, and its model."""
    how = SearchOptions(RecordAssumptions(start='rest'), 1, 1, {}, Deadline())
    base, seen = held_data(split(records), known, how)
    return FixedBaselineEvaluator(seen, 1, 1, base, known), base


@cache
def on_time() -> tuple[Record, ...]:
    return tuple(measured(MODEL, VALUES, 0.0, noise=NOISE))


def with_effect(name: str, hidden: dict[str, float]) -> tuple[ModelSpec, dict[str, float]]:
    """Return a model with an effect, at what the effect begins with and as it truly is."""
    candidate = add_effect(MODEL, described(name)[0])
    spec = ModelSpec(MODEL, VALUES).with_candidate(
        candidate, candidate.values(VALUES, candidate.starts[0])
    )
    return spec, candidate.values(VALUES, dict(candidate.neutral) | hidden)


@pytest.mark.parametrize('late', [0.0, 0.6 * DT, -0.4 * DT])
def test_a_tone_is_guessed_on_the_clock_of_the_model(late: float) -> None:
    """At 90 Hz half a tick is 32 degrees."""
    hum = {'hum_frequency': 90.0, 'hum_sine': 2e-7, 'hum_cosine': 1e-7}
    spec, truth = with_effect('mains_hum', hum)
    views: list[FitData] = [whole(r) for r in measured(spec.model, truth, late, noise=0.0)]
    before = evaluated_on(ModelSpec(MODEL, VALUES, (), late), views)
    promise = Screen(before, views, ()).score(add_effect(MODEL, described('mains_hum')[0]))
    best = promise.starts[0]
    after = evaluated_on(replace(spec, values=best, sampling_offset=late), views)
    assert promise.explained > 0.999
    assert after.rms < 0.05 * before.rms
    for name, value in hum.items():
        # what is read between two samples has lost 3.5 % at this frequency
        assert best[name] == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize('late', [0.3 * DT, -0.3 * DT])
def test_a_clock_that_is_not_that_of_the_file_costs_a_parameter(late: float) -> None:
    records = list(on_time())
    (here, base), (there, _) = held_by(kept(0.0), records), held_by(kept(late), records)
    still = here.evaluated(replace(base, sampling_offset=0.0))
    moved = here.evaluated(replace(base, sampling_offset=late))
    assert here.score(moved) - there.score(moved) == pytest.approx(HELD.price)
    assert there.score(still) - here.score(still) == pytest.approx(HELD.price)


def test_a_clock_within_its_uncertainty_is_that_of_the_file() -> None:
    evaluator, base = held_by(kept(0.0), list(on_time()))

    def price(late: float) -> float:
        # what is left stays below what the file is known to miss, and is no evidence itself
        moved, still = (
            evaluator.evaluated(replace(base, sampling_offset=at)) for at in (late, 0.0)
        )
        return evaluator.score(moved) - evaluator.score(still)

    assert price(STILL) == pytest.approx(0.0, abs=1e-6)
    assert price(10.0 * STILL) == pytest.approx(HELD.price, abs=0.1)


@pytest.mark.parametrize('late', [0.0, 0.3 * DT])
@pytest.mark.parametrize('started', [-0.5 * DT, 0.5 * DT])
def test_a_fit_leaves_the_clock_to_noise_where_it_is(late: float, started: float) -> None:
    evaluator, base = held_by(kept(late), measured(MODEL, VALUES, late, noise=MISSED))
    found = evaluator.fit(replace(base, sampling_offset=late + started))
    assert found is not None
    assert found.sampling_offset == pytest.approx(late, abs=1.1 * STILL)


@pytest.mark.parametrize('late', [0.0, 0.3 * DT])
def test_a_fit_gives_a_delay_to_the_delay_and_not_to_the_clock(late: float) -> None:
    """The voltage is held: what comes late by less than two ticks is one tick late, or early."""
    spec, truth = with_effect('transport_delay', {'delay': 1.5 * DT})
    evaluator, _ = held_by(kept(late), measured(spec.model, truth, late, noise=MISSED))
    found = evaluator.fit(replace(spec, sampling_offset=late - 0.5 * DT))
    assert found is not None
    assert found.sampling_offset == pytest.approx(late, abs=0.05 * DT)
    assert 1.0 <= found.values['delay'] / DT < 2.0


@pytest.mark.parametrize('delay', [2.36, 2.5, 2.8])
def test_the_fraction_of_a_delay_by_ticks_is_a_sampling_offset_without_price(delay: float) -> None:
    """Samples that are read earlier show a response that comes later."""
    spec, truth = with_effect('transport_delay', {'delay': 2.0 * DT})
    records = measured(spec.model, truth, (2.0 - delay) * DT, noise=NOISE)
    evaluator, _ = held_by(kept(0.0, 0.0), records)
    found = evaluator.fit(replace(spec, values={**spec.values, 'delay': 3.0 * DT}))
    assert found is not None
    total = found.values['delay'] - found.sampling_offset
    assert total / DT == pytest.approx(delay, abs=0.03)
    whole_ticks = evaluator.evaluated(replace(spec, values=truth, sampling_offset=0.0))
    assert evaluator.score(found) < evaluator.score(whole_ticks) + 0.1


@pytest.mark.parametrize(
    ('name', 'values', 'response'),
    [
        ('transport_delay', {'delay': 3.0 * DT}, lambda w: np.exp(-3j * w * DT)),
        ('amplifier_lag', {'lag_time': 3.0 * DT}, lambda w: 1.0 / (1.0 + 3j * w * DT)),
        ('drift', {'drift_rate': 1e-7}, lambda w: 1.0),
    ],
)
def test_the_known_discrepancy_comes_as_late_as_the_response(
    name: str, values: dict[str, float], response: Callable[[float], complex]
) -> None:
    spec, truth = with_effect(name, values)
    views = [whole(record) for record in on_time()]
    angle = 10.0 * np.pi * DT * np.arange(views[0].measured.size)
    known: Any = [SimpleNamespace(repeated=np.sin(angle))] * len(views)
    nothing = [np.zeros(angle.size)] * len(views)
    late = replace(spec, values=truth)
    found = with_delayed_discrepancy(late, nothing, views, known, 0.0)
    passed = np.imag(response(10.0 * np.pi) * np.exp(1j * angle))
    settled = slice(50, None)
    wanted = np.sin(angle) - passed
    np.testing.assert_allclose(found[0][settled], wanted[settled], atol=5e-3)


def test_a_sharpened_fit_is_at_the_optimum_of_the_score() -> None:
    spec, truth = with_effect('amplifier_lag', {'lag_time': 2.0 * DT})
    evaluator, _ = held_by(kept(0.0), measured(spec.model, truth, 0.0, noise=NOISE))
    at = evaluator.evaluated(replace(spec, values={**truth, 'lag_time': 1.5 * DT}))
    found = evaluator.sharpened(at)
    assert evaluator.score(found) < evaluator.score(at) - 1.0
    assert found.values['lag_time'] == pytest.approx(2.0 * DT, rel=0.05)
    assert evaluator.sharpened(found).values == found.values


@pytest.mark.parametrize('late', [0.4 * DT, -0.4 * DT])
def test_a_fit_follows_a_clock_that_moved(late: float) -> None:
    evaluator, base = held_by(kept(0.0), measured(MODEL, VALUES, late, noise=NOISE))
    found = evaluator.fit(replace(base, sampling_offset=0.0))
    assert found is not None
    assert found.sampling_offset == pytest.approx(late, abs=0.02 * DT)


@pytest.mark.parametrize(
    ('model', 'std', 'reach'),
    [
        ('classical', 0.0, JITTER),
        ('bouc_wen_mode', 0.05, JITTER + 0.1),
        ('bouc_wen_mode', 3.0, 0.5),
        ('bouc_wen_mode', None, 0.5),
        # what takes less than a sample is in the clock of a chain that answers at once
        ('classical', 0.01, 0.5),
    ],
)
def test_a_held_clock_moves_by_what_clocks_move(
    model: str, std: float | None, reach: float
) -> None:
    file = kept(0.3 * DT, None if std is None else std * DT, named(model))
    low, high = clock_about(ModelFile.parse(file.text()), DT)
    assert (low / DT, high / DT) == pytest.approx((0.3 - reach, 0.3 + reach))


@pytest.mark.parametrize('ticks', [0, 1, 2])
def test_discover_and_validate_agree_that_a_tick_is_a_delay(ticks: int) -> None:
    file = kept(0.0, 0.0)
    late = [
        replace(r, voltage=np.roll(r.voltage, -ticks)[:1990], displacement=r.displacement[:1990])
        for r in on_time()
    ]
    views = [replace(whole(r), own_zero=True) for r in late]
    clock = clock_of(file, views)
    assert abs(clock) <= 1.001 * JITTER * DT
    left = list(map(residual_of, late, predictions(MODEL, VALUES, views, clock)))
    evaluator, base = held_by(file, late)
    assert file.discrepancy is not None
    assert evaluator.exceeds_discrepancy(base) == any(
        c.new_deviation for c in compared(left, file.discrepancy)
    )
    assert evaluator.exceeds_discrepancy(base) == (ticks > 0)
    assert evaluator.unseen_delay == pytest.approx(JITTER * DT)


@pytest.mark.component
def test_a_recording_a_tick_late_is_read_to_its_last_sample() -> None:
    model = named('bouc_wen_mode')
    values = {**model.defaults(), 'natural_frequency': 19.0, 'damping_ratio': 0.09}
    packed, dt = model.pack(values), 2e-3
    u = np.sin(2 * np.pi * 8.0 * dt * np.arange(1500))
    # the displacement at the end of a tick, at which its voltage has acted
    y = model.respond(np.append(u, u[-1]), packed, dt)[1:]
    target = whole(Record('late', dt, u, y))
    for share in (0.6, 1.0):
        part = part_of(target, 0, round(share * target.measured.size))
        error = Prediction(model, packed, part, dt).residual
        assert np.max(np.abs(error)) < 1e-9 * np.ptp(y)
