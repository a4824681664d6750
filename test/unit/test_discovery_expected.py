"""What a model is known to miss is taken off in phase, and what its values leave open counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.dataset import cut
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import widened
from piezo_hysteresis.discovery.selection.residual_model import expectation
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.model_discrepancy import (
    RecordResidual,
    condition_of,
    drive_lines,
)
from piezo_hysteresis.models import Condition, Discrepancy, named
from piezo_hysteresis.records import Record, RecordInfo

DT, STROKE = 2e-3, 4e-5
TIME = DT * np.arange(4000)
GROWING = np.minimum(TIME / 6.0, 1.0)


def third(begin: float = 0.0) -> np.ndarray:
    """Return an error on the third harmonic of a drive at 2 Hz that began earlier [m]."""
    return np.asarray(3e-7 * np.cos(3 * 2 * np.pi * 2.0 * (TIME + begin) + 0.4))


def drive(begin: float = 0.0) -> np.ndarray:
    return np.asarray(np.sin(2 * np.pi * 2.0 * (TIME + begin)))


def record(voltage: np.ndarray, error: np.ndarray) -> Record:
    info = RecordInfo(excitation='sine', frequency=2.0, amplitude=1.0)
    return Record('r', DT, voltage, 2e-5 * voltage + error, info=info)


def condition(voltage: np.ndarray, error: np.ndarray) -> Condition:
    return condition_of(RecordResidual('r', error, DT, 2.0, 1.0, STROKE, 1e-9, 0.0, voltage))


def test_a_repeating_discrepancy_is_predicted_by_the_phase_of_the_drive() -> None:
    known = Discrepancy(True, (condition(drive(), third()),))
    later = replace(whole(record(drive(0.123), third(0.123))), noise=1e-9)
    expected = expectation(later, known, STROKE)
    left = third(0.123) - expected.repeated
    assert np.std(left) < 0.05 * np.std(third())
    assert expected.octaves == 0.0
    # an eighth of what is missed would be news in phase, all of it is none without
    assert expected.new_deviation(expected.powers(third(0.123) - 0.3 * expected.repeated))
    assert not expected.out_of_phase().new_deviation(expected.powers(third(0.02)))


def test_coloured_noise_is_expected_where_it_is() -> None:
    memory, count = 0.6, TIME.size
    white = np.random.default_rng(4).standard_normal(count)
    noise = np.zeros(count)
    for k in range(1, count):
        noise[k] = memory * noise[k - 1] + white[k]
    noise *= 1e-7 / np.std(noise)
    known = Discrepancy(True, (condition(drive(), 1e-12 * third()),))
    view = replace(whole(record(drive(), noise)), noise=1e-7, noise_colour=memory)
    expected = expectation(view, known, STROKE)
    assert np.all(expected.expected >= 0.0)
    kept = expected.independent >= 20
    ratio = expected.powers(noise)[kept] / expected.expected[kept]
    assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_a_small_change_costs_half_its_squared_distance() -> None:
    known = Discrepancy(True, (condition(drive(), third()),))
    view = replace(whole(record(drive(), third())), noise=1e-8)
    expected = expectation(view, known, STROKE)
    change = 1e-3 * (third() + np.random.default_rng(2).normal(0.0, 1e-8, TIME.size))
    powers = expected.powers(change)
    distance = float(np.sum(expected.whitened(change) ** 2))
    assert distance == pytest.approx(float(expected.independent @ (powers / expected.expected)))


def test_a_file_and_new_records_are_split_alike_where_the_drive_grows() -> None:
    error = GROWING * third() + 2e-7 * GROWING
    lines = drive_lines(GROWING * drive(), DT, 2.0)
    assert lines is not None
    assert np.any(lines.orders == 0)
    _, beside = lines.split(error - error.mean())
    assert np.std(beside) < 0.05 * np.std(error)
    found = condition(GROWING * drive(), error)
    assert sum(size**2 for size in found.bands.values()) < 1e-3 * found.rms**2
    size = np.sqrt(np.mean((GROWING * third()) ** 2))
    assert found.harmonics[3] == pytest.approx(size, rel=0.02)
    assert found.phases[3] == pytest.approx(0.4 - np.pi / 2, abs=0.05)


def test_a_discrepancy_repeats_with_a_drive_whose_period_wanders() -> None:
    """On a rig that reverses at a position, lines of one run lay between those of another."""

    def run(wander: float) -> tuple[np.ndarray, np.ndarray]:
        phase = 4 * np.pi * TIME + wander * np.sin(2 * np.pi * TIME / 8.0 + wander)
        lines = ((1, 2e-7, 0.3), (5, 3e-7, 1.1), (9, 4e-7, -0.8), (11, 3e-7, 2.0))
        return np.cos(phase), sum(a * np.cos(n * phase + at) for n, a, at in lines)

    known = Discrepancy(False, (condition(*run(0.1)), condition(*run(0.1))))
    for wander in (0.1, 0.25, -0.3):
        voltage, error = run(wander)
        expected = expectation(replace(whole(record(voltage, error)), noise=1e-9), known, STROKE)
        assert not expected.new_deviation(expected.powers(error - expected.repeated)), wander
        assert expected.new_deviation(expected.powers(1.5 * error - expected.repeated)), wander


def test_uncertainty_of_values_is_no_deviation_at_other_conditions() -> None:
    model = named('linear_mode')
    values = {**model.defaults(), 'A1': 2e-5, 'natural_frequency': 60.0, 'damping_ratio': 0.05}
    base = ModelSpec(model, values)
    view = replace(whole(record(drive(), 0.0 * TIME)), noise=1e-9)
    names, spread = model.free_names, np.diag([1e-14 for _ in model.free_names])
    spread[names.index('A1'), names.index('A1')] = (1e-7) ** 2

    def more(frequency: float) -> float:
        known = Discrepancy(True, (Condition(frequency, 1.0, STROKE, 1e-9),))
        expected = expectation(view, known, STROKE)
        (wider,) = widened((expected,), base, (view,), names, spread)
        return float(wider.expected[1] - expected.expected[1])

    assert more(2.0) < 1e-3 * more(8.0)
    assert more(8.0) == pytest.approx(0.5 * 1e-14, rel=0.15)
    known = Discrepancy(True, (Condition(8.0, 1.0, STROKE, 1e-9),))
    expected = expectation(view, known, STROKE)
    assert widened((expected,), base, (view,), names[:1], spread[:1, :1])[0] is expected


@pytest.mark.parametrize('grows', [GROWING, np.ones(TIME.size)], ids=['growing', 'steady'])
def test_variation_between_parts_is_no_deviation_in_one_part(grows: np.ndarray) -> None:
    """A fit makes the mean of a harmonic small; the last quarter of the same record has it all."""
    parts = np.where(np.arange(TIME.size) < 3000, -0.2, 1.0)
    error = grows * (third() * parts + 5e-8 * np.cos(9 * 4 * np.pi * TIME))
    voltage = grows * drive()
    found = condition(voltage, error)
    assert found.scatter[3] == pytest.approx(0.6 * np.std(third()), rel=0.3)
    assert Condition.parse(found.to_dict()).scatter[3] == pytest.approx(found.scatter[3], rel=1e-3)
    view = replace(whole(record(voltage, error)), noise=1e-9)
    last = cut(view, 0.75)[1]

    def new_deviation(known: Condition, size: float = 1.0) -> bool:
        expected = expectation(last, Discrepancy(False, (known,)), STROKE)
        return expected.new_deviation(expected.powers(size * error[-last.measured.size :]))

    assert not new_deviation(found)
    assert new_deviation(found, 4.0)
    assert new_deviation(replace(found, scatter={}))


def test_what_is_expected_does_not_depend_on_the_unit_of_the_voltage() -> None:
    error = GROWING * third()
    found = []
    for factor in (1.0, 60.0):
        voltage = factor * GROWING * drive()
        known = replace(condition(GROWING * drive(), error), scatter={3: 1e-7}, amplitude=factor)
        view = replace(whole(record(voltage, error)), noise=1e-9)
        found.append(expectation(view, Discrepancy(False, (known,)), STROKE).expected)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
