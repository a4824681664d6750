"""The raster: lines of a scan whose turn-arounds are smooth, and corners that rounding leaves."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.waveforms import Triangle, WaveformError, from_spec
from piezo_hysteresis.waveforms.corners import Raster


@pytest.mark.parametrize(('trace', 'turn'), [(0.5, 0.1), (0.8, 0.2), (0.3, 0.05), (0.9, 0.1)])
def test_velocity_and_acceleration_are_derivatives(trace: float, turn: float) -> None:
    wave = Raster(2.0, 1.0, 0.3, frequency=4.0, phase=0.7, trace=trace, turn=turn)
    h = 1e-6
    time = np.arange(7300, dtype=np.float64) * 1.37e-4
    later = np.arange(7300, dtype=np.float64) * 1.37e-4 + h
    earlier = np.arange(7300, dtype=np.float64) * 1.37e-4 - h
    at, above, below = wave.sample(time), wave.sample(later), wave.sample(earlier)
    speed = np.max(np.abs(at.velocity))
    assert np.allclose((above.value - below.value) / (2 * h), at.velocity, atol=1e-4 * speed)
    bend = np.max(np.abs(at.acceleration))
    slope = (above.velocity - below.velocity) / (2 * h)
    assert np.allclose(slope, at.acceleration, atol=1e-3 * bend)


def test_straight_parts_lie_on_the_lines_through_the_corners() -> None:
    sharp = Raster(2.0, 1.0, 0.3, frequency=4.0, trace=0.8)
    smooth = Raster(2.0, 1.0, 0.3, frequency=4.0, trace=0.8, turn=0.1)
    time = np.arange(0.0, 1.0, 1e-4)
    one, other = sharp.sample(time), smooth.sample(time)
    straight = other.acceleration == 0.0
    assert 0.78 < np.mean(straight) < 0.82
    assert np.allclose(one.value[straight], other.value[straight], atol=1e-12)
    assert np.max(np.abs(sharp.sample(np.array([0.1])).value - 2.3)) < 1e-12


def test_rounding_never_moves_a_corner_by_a_tick() -> None:
    """A corner on a tick has the slope that follows it, however long the record is."""
    wave = Triangle(1.0, 10.0, frequency=50.0)
    time = np.arange(100_000, dtype=np.float64) * 1e-4
    velocity = wave.sample(time).velocity.reshape(-1, 200)
    assert np.array_equal(velocity, np.broadcast_to(velocity[0], velocity.shape))


def test_impossible_settings_are_refused() -> None:
    for wrong in ({'trace': 0.0}, {'trace': 0.9, 'turn': 0.2}):
        with pytest.raises(WaveformError, match=r'trace|turn-around'):
            Raster(1.0, 1.0, **wrong)
    made = from_spec({'kind': 'raster', 'frequency': 20.0, 'trace': 0.7, 'turn': 0.1})
    assert isinstance(made, Raster)
