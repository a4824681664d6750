"""References given by their samples have derivatives as good as those of formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.waveforms import Sine, Triangle
from piezo_hysteresis.waveforms.waveform import Sampled

DT = 1e-3
TIME: FloatArray = DT * np.arange(2000, dtype=np.float64)


@pytest.mark.parametrize('frequency', [1.0, 25.0, 60.0])
def test_derivatives_of_samples_are_those_of_the_formula(frequency: float) -> None:
    omega = 2.0 * np.pi * frequency
    found = Sampled(np.sin(omega * TIME), DT).sample(TIME)
    inner = slice(10, -10)  # a spline knows less at its ends
    assert found.velocity[inner] == pytest.approx(
        omega * np.cos(omega * TIME)[inner], abs=1e-4 * omega
    )
    bend = -(omega**2) * np.sin(omega * TIME)[inner]
    assert found.acceleration[inner] == pytest.approx(bend, abs=1e-3 * omega**2)


@pytest.mark.parametrize('frequency', [5.0, 5.1])
def test_a_corner_disturbs_its_own_samples_only(frequency: float) -> None:
    exact = Triangle(1e-4, 2.0, frequency=frequency).sample(TIME)
    found = Sampled(exact.value, DT).sample(TIME)
    wrong = np.abs(found.velocity - exact.velocity) > 1e-3 * np.abs(exact.velocity).max()
    corners = np.count_nonzero(np.diff(exact.velocity))
    assert corners >= 20
    assert np.count_nonzero(wrong) <= 2 * corners


def test_a_step_has_no_derivative_elsewhere() -> None:
    found = Sampled(np.where(TIME < 1.0, 0.0, 1e-5), DT).sample(TIME)
    far = np.abs(TIME - 1.0) > 3.0 * DT
    assert np.max(np.abs(found.velocity[far])) < 1e-12
    assert np.max(np.abs(found.acceleration[far])) < 1e-8


@pytest.mark.component
def test_a_mode_follows_an_array_as_it_follows_the_waveform(tmp_path: Path) -> None:
    chain = named('bouc_wen_mode')
    ModelFile(chain, {**chain.defaults(), 'natural_frequency': 68.0}).save(tmp_path / 'm.yaml')
    model = ph.Model.load(tmp_path / 'm.yaml')
    wave = Sine(2e-6, 25.0, 2.0)
    by_wave, by_array = (
        ph.compensate(model, each, dt=DT, attenuation='none').runs[-1].metrics.rms
        for each in (wave, wave.sample(TIME).value)
    )
    assert by_array < 1.1 * by_wave
