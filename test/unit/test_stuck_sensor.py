"""A sensor that is stuck is named; one that rests with its actuator is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from piezo_hysteresis.common.node_sheet import Level
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.runtime.link_health import LinkHealth, StuckSensor

DT = 1e-3


@pytest.mark.parametrize('flicker', [0.0, 1e-12])
def test_a_stuck_sensor_is_counted(flicker: float) -> None:
    """Also where the last bit of its float32 flickers."""
    sensor = StuckSensor(DT)
    for k in range(1000):
        voltage = math.sin(2 * math.pi * 5.0 * k * DT)
        sensor.update(voltage, 1e-4 * voltage if k < 500 else 3e-5 + flicker * (k % 2))
    assert 300 < sensor.ticks <= 400


@pytest.mark.parametrize('kind', ['moves', 'rests', 'saturated', 'settles', 'not_a_number'])
def test_a_sound_sensor_is_not(kind: str) -> None:
    sensor = StuckSensor(DT)
    rng = np.random.default_rng(1)
    for k in range(2000):
        voltage = 1.0 + {'moves': math.sin(0.03 * k), 'settles': math.exp(-0.02 * k)}.get(
            kind, 0.0
        )
        noise = 1e-9 * rng.standard_normal() if kind == 'moves' else 0.0
        displacement = math.nan if kind == 'not_a_number' else 1e-4 * voltage + noise
        sensor.update(voltage, displacement)
    assert sensor.ticks == 0


def test_it_is_named_in_the_diagnostics() -> None:
    class Quiet:
        stale, newest = False, 0

    health = LinkHealth(Limits())
    numbers = {'sample': 1, 'active': True}
    found = health.judge(numbers, {'stuck_sensor': 3}, Quiet())  # type: ignore[arg-type]
    assert found.level == Level.ERROR
    assert 'the sensor is stuck' in found.message
