"""Good samples are not excluded; what the sensor lost is found, named and taken out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.measurement import as_measured, corrected
from piezo_hysteresis.identification.noise import bad_samples, steps_of
from piezo_hysteresis.records import Record

RATE = 1000.0


def plays(voltage: np.ndarray) -> np.ndarray:
    """Return the displacement of ten plays from rest, of 15 um at 100 V [m]."""
    levels, y = np.zeros(10), np.empty(voltage.size)
    widths = np.linspace(2.0, 40.0, 10)
    for k, u in enumerate(voltage):
        levels = np.clip(levels, u - widths, u + widths)
        y[k] = 1.1e-7 * u + 4e-9 * levels.sum()
    return y


def sine(frequency: float = 1.0, seconds: float = 4.0) -> np.ndarray:
    return 50.0 * (1.0 - np.cos(2 * np.pi * frequency * np.arange(RATE * seconds) / RATE))


def record(voltage: np.ndarray, seed: int = 0) -> Record:
    noise = 5e-9 * np.random.default_rng(seed).standard_normal(voltage.size)
    return Record('a', 1.0 / RATE, voltage, plays(voltage) + noise)


DRIVES = {
    'virgin curve': sine(),
    'fast': sine(21.0),
    'staircase': np.repeat(np.random.default_rng(3).uniform(0, 100, 40), 100),
    'pulses': np.where(np.arange(4000) % 500 > 459, 90.0, 0.0),
    'impulses': np.where(np.arange(4000) % 500 > 498, 90.0, 0.0),
    'coarse triangle': 100.0 * np.abs((np.arange(240) / 20.0 + 1.0) % 2.0 - 1.0),
}


@pytest.mark.parametrize('kind', DRIVES)
def test_what_the_voltage_explains_is_no_outlier(kind: str) -> None:
    good = record(DRIVES[kind])
    late = replace(good, displacement=np.r_[good.displacement[:1], good.displacement[:-1]])
    for each in (good, late):
        found = ph.identify(each, 'prandtl_ishlinskii', max_evaluations=5)
        assert found.records[0].lost == 0
        assert not steps_of(each)


def test_the_error_counts_what_is_excluded() -> None:
    good = record(sine())
    spoilt = good.displacement.copy()
    spoilt[2503] += 3e-6
    found = ph.identify(replace(good, displacement=spoilt), 'prandtl_ishlinskii')
    assert found.records[0].lost == 1
    assert found.records[0].free_run_rms > 3e-6 / np.sqrt(spoilt.size)
    assert any('1 sample excluded from the fit' in each for each in found.warnings)


@pytest.mark.parametrize('height', [1.58e-7, -6e-6])
@pytest.mark.parametrize('kind', ['virgin curve', 'staircase'])
def test_a_step_of_the_counter_is_found_and_taken_out(kind: str, height: float) -> None:
    good = record(DRIVES[kind])
    slipped = good.displacement.copy()
    slipped[2650:] += height
    spoilt = replace(good, displacement=slipped)
    (step,) = steps_of(spoilt)
    assert step.sample == 2650
    assert step.height == pytest.approx(height, abs=2e-8)
    assert corrected(spoilt).displacement == pytest.approx(good.displacement, abs=2e-8)
    assert '`import --without-steps`' in as_measured([spoilt])[1][0]


@pytest.mark.parametrize('codes', [(-0.01,), (1.0, -1.0), (0.0327, -2e-4)])
def test_codes_of_a_sensor_are_no_displacement(codes: tuple[float, ...]) -> None:
    good = record(sine())
    spoilt, places = good.displacement.copy(), np.random.default_rng(1).permutation(4000)[:60]
    spoilt[places] = np.resize(codes, 60)
    given = replace(good, displacement=spoilt)
    (usable,), (remark,) = as_measured([given])
    assert '60 readings' in remark
    assert usable.displacement == pytest.approx(good.displacement, abs=1e-7)
    assert set(np.flatnonzero(bad_samples(given))) >= set(places)
    found = ph.identify(given, 'prandtl_ishlinskii')
    assert found.records[0].free_run_rms < 1.5e-8


def test_a_displacement_beyond_the_range_of_the_sensor_is_a_code() -> None:
    good = record(sine())
    spoilt = np.where(good.voltage > 90.0, -0.01, good.displacement)
    (usable,), _ = as_measured([replace(good, displacement=spoilt)])
    assert np.ptp(usable.displacement) < 1.6e-5


def test_an_even_response_is_named() -> None:
    drive = 100.0 * np.sin(2 * np.pi * np.arange(4000) / RATE)
    good = record(drive)
    even = replace(good, displacement=plays(np.abs(drive)))
    with pytest.raises(IdentificationError, match='a butterfly'):
        ph.identify(even, 'prandtl_ishlinskii')
    noise = np.random.default_rng(0).standard_normal(4000)
    with pytest.raises(IdentificationError, match='nothing in common'):
        ph.identify(replace(good, displacement=1e-6 * noise), 'prandtl_ishlinskii')
