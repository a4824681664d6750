"""What a model left of records at hand: found where the same drive comes again."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.models.repeating import MOST, SAME, Trace, stretches_of

DT, PERIOD = 1e-3, 100


def trace(periods: int = 6, begins: str = '') -> Trace:
    k = np.arange(PERIOD * periods, dtype=np.float64)
    voltage = np.sin(2 * np.pi * k / PERIOD)
    return Trace(voltage, k * 1e-9, DT, begins)


def test_every_stretch_under_the_same_voltage_is_found_once() -> None:
    found = trace().stretches(trace(2).voltage, DT)
    begins = [round(error[0] / 1e-9) for _, error in found]
    assert begins == [0, 100, 200, 300, 400]
    assert all(error.size == 2 * PERIOD and off < 1e-9 for off, error in found)


@pytest.mark.parametrize(
    ('factor', 'dt', 'periods'), [(1.1, DT, 2), (1.0, 2 * DT, 2), (1.0, DT, 7), (0.0, DT, 2)]
)
def test_another_drive_rate_or_length_is_found_nowhere(
    factor: float, dt: float, periods: int
) -> None:
    assert trace().stretches(factor * trace(periods).voltage, dt) == []
    assert stretches_of([trace()], factor * trace(periods).voltage, dt) is None


def test_a_voltage_that_was_measured_with_noise_is_the_same() -> None:
    voltage = trace(2).voltage
    noise = np.random.default_rng(1).standard_normal(voltage.size) * np.std(voltage)
    assert len(trace().stretches(voltage + 0.5 * SAME * noise, DT)) == 5
    assert trace().stretches(voltage + 2.0 * SAME * noise, DT) == []


def test_the_nearest_stretches_of_all_records_come_first_and_are_not_too_many() -> None:
    near, far = trace(40), trace(40)
    far = Trace(1.01 * far.voltage, far.error + 1.0, DT)
    found = stretches_of([far, near], trace(2).voltage, DT, stride=7)
    assert found is not None
    assert found.shape == (MOST, len(range(0, 2 * PERIOD, 7)))
    assert np.all(found < 1.0)
    assert found[0, 1] - found[0, 0] == pytest.approx(7e-9)


def test_a_record_began_so_where_drive_and_way_are_the_same() -> None:
    known, voltage = trace(begins='estimate'), trace(8).voltage
    assert known.began_similarly(voltage, DT, 'estimate')
    assert not known.began_similarly(voltage, DT, 'step')
    assert not known.began_similarly(voltage[PERIOD // 4 :], DT, 'estimate')
    assert not known.began_similarly(voltage, 2 * DT, 'estimate')
