"""A loop closes on a sensor that follows the voltage, and on no other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.runtime.link_health import SensorSign, Sign
from piezo_sim.plant import Plant

DT = 1e-3
SPAN = 2.4
GAIN = 1.2e-4
KNOWN = ModeGain(GAIN, 68.0, 0.015, DT)
UNKNOWN = ModeGain(math.inf, dt=DT)
# Smallest amplitude of a sinusoid that is enough, relative to the range of the voltage.
ENOUGH = 0.02


def measured(voltage: FloatArray) -> FloatArray:
    """Return what the simulated bender answers, with its hysteresis, mode, creep and noise [m]."""
    return Plant.from_preset('fdk_pzba_00030', rate=1.0 / DT, seed=3).run(voltage)


def sine(amplitude: float, frequency: float, offset: float = 0.0) -> FloatArray:
    time = DT * np.arange(3000)
    rise = np.minimum(1.0, time / 0.2)
    return np.asarray(rise * (offset + amplitude * np.sin(2 * math.pi * frequency * time)))


def checked(voltage: FloatArray, displacement: FloatArray, plant: ModeGain) -> SensorSign:
    sign = SensorSign(DT)
    sign.expect(plant, SPAN)
    for v, y in zip(voltage.tolist(), displacement.tolist(), strict=True):
        sign.update(v, y)
    return sign


@pytest.mark.parametrize('plant', [KNOWN, UNKNOWN])
@pytest.mark.parametrize('frequency', [0.5, 5.0, 20.0])
@pytest.mark.parametrize('amplitude', [ENOUGH * SPAN, 0.8])
def test_the_sign_is_known(plant: ModeGain, frequency: float, amplitude: float) -> None:
    voltage = sine(amplitude, frequency)
    displacement = measured(voltage)
    right = checked(voltage, displacement, plant)
    assert right.found is Sign.RIGHT
    assert right.may_close()
    wrong = checked(voltage, -displacement, plant)
    assert wrong.found is Sign.REVERSED
    assert not wrong.may_close()
    assert wrong.counters() == {'reversed_sensor': 1, 'still_sensor': 0}


@pytest.mark.parametrize('frequency', [40.0, 68.0, 90.0, 200.0])
def test_no_right_sensor_is_refused_about_a_resonance(frequency: float) -> None:
    """There the displacement is opposite to the voltage, whatever the sensor."""
    voltage = sine(0.1, frequency)
    displacement = measured(voltage)
    for plant in (KNOWN, UNKNOWN):
        assert checked(voltage, displacement, plant).found in (Sign.RIGHT, Sign.UNKNOWN)


@pytest.mark.parametrize('drift', [-1e-6, 1e-6])
def test_a_small_reference_decides_nothing_against_drift(drift: float) -> None:
    voltage = sine(0.1 * ENOUGH * SPAN, 5.0)
    displacement = measured(voltage) + drift * DT * np.arange(voltage.size)
    sign = checked(voltage, displacement, KNOWN)
    assert sign.found is Sign.UNKNOWN
    assert not sign.may_close()  # it waits from when the law first acts
    for _ in range(2001):
        sign.update(0.0, 0.0)
    assert sign.may_close()
    assert not any(sign.counters().values())


def test_a_sensor_that_does_not_follow_is_refused_where_the_gain_is_known() -> None:
    voltage = sine(0.5, 5.0)
    noise = 2e-8 * np.random.default_rng(5).standard_normal(voltage.size)
    assert checked(voltage, noise, KNOWN).found is Sign.STILL
    assert checked(voltage, noise, UNKNOWN).found is not Sign.STILL


def test_a_plant_that_falls_is_expected_to_fall() -> None:
    voltage = sine(0.5, 5.0)
    displacement = measured(voltage)
    falling = KNOWN._replace(gain=-GAIN)
    assert checked(voltage, -displacement, falling).found is Sign.RIGHT
    assert checked(voltage, displacement, falling).found is Sign.REVERSED


def test_another_model_of_the_same_sign_leaves_a_loop_closed() -> None:
    voltage = sine(0.5, 5.0)
    sign = checked(voltage, measured(voltage), KNOWN)
    sign.expect(KNOWN._replace(gain=2.0 * GAIN), SPAN)
    assert sign.may_close()
    sign.expect(KNOWN._replace(gain=-GAIN), SPAN)
    assert not sign.may_close()
