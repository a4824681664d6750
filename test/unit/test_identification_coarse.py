"""Steps of a coarse sensor are no spikes; spikes between them are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.identification.outliers import outliers, step_of

PERIOD, COUNT = 200, 12
DRIVE = 50.0 * np.sin(2 * np.pi * np.arange(PERIOD * COUNT) / PERIOD)


def sensed(step: float, noise: float, seed: int) -> np.ndarray:
    """Return a sine of 100 um as a sensor with steps of that size reads it [m]."""
    t = np.arange(PERIOD * COUNT) / PERIOD
    y = 1e-4 * np.sin(2 * np.pi * t) + noise * np.random.default_rng(seed).standard_normal(t.size)
    return np.round(y / step) * step


@pytest.mark.component
@settings(max_examples=40, deadline=None)
@given(st.floats(1e-8, 2e-6), st.floats(0.0, 3.0), st.integers(0, 99))
def test_steps_are_no_outliers(step: float, noise_in_steps: float, seed: int) -> None:
    y = sensed(step, noise_in_steps * step, seed)
    assert not np.any(outliers(DRIVE, y, PERIOD))


@pytest.mark.parametrize('noise_in_steps', [0.05, 0.3, 1.0])
def test_a_spike_between_steps_is_found(noise_in_steps: float) -> None:
    step = 5e-7
    y = sensed(step, noise_in_steps * step, 3)
    y[[731, 1490]] += 2e-5
    assert np.flatnonzero(outliers(DRIVE, y, PERIOD)).tolist() == [731, 1490]


def test_the_step_of_a_sensor_is_reported() -> None:
    assert step_of(sensed(5e-7, 2e-7, 1)) == pytest.approx(5e-7, rel=1e-6)
    assert step_of(np.full(5, 2e-6)) == 0.0


@pytest.mark.parametrize('phase', [0.0, 1.5, 2.6, 4.0])
def test_a_ring_from_before_the_record_is_no_outlier(phase: float) -> None:
    """About an offset that creeps away, cut anywhere in its swing; a spike after it is found."""
    k, rng = np.arange(20_000), np.random.default_rng(3)
    u = np.where(k % 2500 < 2250, k % 2500 / 2250.0, 10.0 - k % 2500 / 250.0)
    y = 1e-6 * u + 1e-9 * rng.standard_normal(k.size)
    y -= 17e-9 * np.exp(-k / 3000.0) * (1.0 + np.exp(-k / 150.0) * np.cos(0.48 * k + phase))
    assert not np.any(outliers(u, y, 2500))
    y[700] += 60e-9
    assert list(np.flatnonzero(outliers(u, y, 2500))) == [700]
