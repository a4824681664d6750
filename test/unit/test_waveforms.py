"""Waveforms: derivatives of formulas, samples and rasters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.waveforms import (
    KINDS,
    Multisine,
    Sequence,
    Sine,
    Triangle,
    WaveformError,
    from_spec,
    reversal_curves,
    staircase,
    step_and_hold,
)
from piezo_hysteresis.waveforms.sine import Raster
from piezo_hysteresis.waveforms.waveform import Sampled

SPECS: dict[str, dict[str, object]] = {
    'sine': {'amplitude': 2.0, 'frequency': 3.0, 'phase': 0.4, 'offset': 0.5, 'ramp': 1.0},
    'triangle': {'amplitude': 2.0, 'frequency': 3.0, 'phase': 0.4, 'ramp': 2.0},
    'multisine': {'frequency': 1.0, 'highest': 20.0, 'grid': 'odd_random', 'seed': 3},
    'chirp': {'frequency': 1.0, 'highest': 30.0, 'law': 'logarithmic', 'ramp': 0.5},
    'staircase': {'amplitude': 2.0, 'rise': 0.3},
    'step': {'amplitude': 2.0, 'duration': 10.0},
    'reversal_curves': {'amplitude': 1.5, 'curves': 3},
    'rest': {'level': 0.3},
    'lines': {'times': [0.0, 1.0, 4.0], 'values': [0.0, 2.0, -1.0]},
    'decay': {'amplitude': 2.0, 'frequency': 5.0, 'duration': 1.4, 'offset': 0.5},
    'sum': {'frequencies': [2.0, 5.0], 'weights': [1.0, 0.3], 'phases': [0.1, 0.2]},
    'sequence': {'parts': [{'kind': 'sine', 'duration': 2.3}, {'kind': 'chirp', 'duration': 3.0}]},
}


@pytest.mark.parametrize('kind', sorted(KINDS))
def test_velocity_and_acceleration_are_the_derivatives(kind: Any) -> None:
    waveform = from_spec({'kind': kind, **SPECS.get(kind, {})})
    rng = np.random.default_rng(5)
    h = 1e-6
    time = np.sort(rng.uniform(0.01, waveform.duration - 0.01, 400))
    before, at, after = (waveform.sample(time + shift) for shift in (-h, 0.0, h))
    # Two instants that straddle a corner say nothing about either side of it.
    smooth = np.abs(before.velocity - after.velocity) <= 1e-3 * (1 + np.abs(at.acceleration))
    assert smooth.mean() > 0.95
    slope = (after.value - before.value) / (2 * h)
    bend = (after.velocity - before.velocity) / (2 * h)
    turn = (after.phase - before.phase) / (4 * np.pi * h)
    scale = 1.0 + np.abs(at.velocity).max()
    np.testing.assert_allclose(at.velocity[smooth], slope[smooth], atol=1e-6 * scale)
    scale = 1.0 + np.abs(at.acceleration).max()
    np.testing.assert_allclose(at.acceleration[smooth], bend[smooth], atol=1e-5 * scale)
    np.testing.assert_allclose(at.frequency, turn, atol=1e-4 * (1 + np.abs(turn).max()))


@pytest.mark.parametrize('kind', sorted(KINDS))
def test_every_kind_builds_from_its_defaults_and_any_shape_of_time(kind: Any) -> None:
    waveform = from_spec({'kind': kind})
    time = np.linspace(0.0, waveform.duration, 12).reshape(3, 4)
    samples = waveform.sample(time)
    for column in vars(samples).values():
        assert column.shape == (3, 4)
        assert np.all(np.isfinite(column))
    flat = waveform.sample(time.ravel())
    np.testing.assert_array_equal(flat.value, samples.value.ravel())


@pytest.mark.parametrize(
    ('spec', 'reason'),
    [
        ({'kind': 'sawtooth'}, 'there is no waveform sawtooth; there are sine'),
        ({'amplitude': 1.0}, 'there is no waveform'),
        (
            {'kind': 'sine', 'freqency': 3.0},
            "no setting 'freqency' .did you mean frequency.*; it has amplitude",
        ),
        ({'kind': 'sine', 'frequency': -3.0}, 'must lie within'),
        ({'kind': 'sine', 'frequency': float('nan')}, 'must lie within'),
        ({'kind': 'sine', 'frequency': '3'}, 'is a number'),
        ({'kind': 'sine', 'frequency': True}, 'is a number'),
        ({'kind': 'multisine', 'grid': 'even'}, 'one of full, odd, odd_random'),
        ({'kind': 'multisine', 'frequency': 10.0, 'highest': 5.0}, 'choose `highest`'),
        ({'kind': 'staircase', 'steps': 2.5}, 'whole number'),
        ({'kind': 'staircase', 'rise': 2.0}, 'does not fit'),
        ({'kind': 'step', 'delay': 20.0}, 'outside'),
        ({'kind': 'sum', 'frequencies': []}, 'at least one'),
        ({'kind': 'sum', 'frequencies': [1.0], 'phases': [0.0, 1.0]}, 'as many phases'),
        ({'kind': 'sequence', 'parts': []}, 'at least one part'),
        ({'kind': 'sequence', 'parts': [{'kind': 'x'}]}, 'no waveform x'),
    ],
)
def test_a_wrong_specification_is_refused_with_the_reason(
    spec: dict[str, Any], reason: str
) -> None:
    with pytest.raises(WaveformError, match=reason.replace('(', r'\(')):
        from_spec(spec)


def test_integers_and_floats_are_interchangeable() -> None:
    assert vars(from_spec({'kind': 'sine', 'frequency': 3}))['frequency'] == 3.0
    assert from_spec({'kind': 'staircase', 'steps': 4.0}) == staircase(1.0, 4, 1.0)


def _lines(waveform: Multisine, period: float, highest: float) -> FloatArray:
    time = np.arange(4096) / 4096 * period
    return np.abs(np.fft.rfft(waveform.sample(time).value))[: int(highest * period) + 2] / 2048


@pytest.mark.parametrize('grid', ['full', 'odd', 'odd_random'])
def test_a_multisine_excites_its_grid_evenly_up_to_its_peak(grid: str) -> None:
    waveform = Multisine(2.0, 0.5, 40.0, 10.0, grid=grid, seed=1)
    lines = _lines(waveform, 2.0, 40.0)
    excited = np.flatnonzero(lines > 1e-6)
    step = 1 if grid == 'full' else 2
    expected = set(range(1, 81, step))
    assert set(excited) <= expected
    # One odd line of every four is a detection line on the random grid.
    assert len(expected) - len(excited) == (len(expected) // 4 if grid == 'odd_random' else 0)
    np.testing.assert_allclose(lines[excited], lines[excited[0]], rtol=1e-9)
    peak = np.abs(waveform.sample(np.linspace(0.0, 2.0, 50_001)).value).max()
    assert peak == pytest.approx(2.0, rel=0.01)


def test_the_seed_decides_the_multisine() -> None:
    time = np.linspace(0.0, 1.0, 50)
    one, same, other = (
        Multisine(1.0, 1.0, 9.0, 1.0, seed=s).sample(time).value for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.1


@pytest.mark.parametrize('law', ['linear', 'logarithmic'])
def test_a_chirp_runs_between_its_frequencies(law: str) -> None:
    chirp = from_spec({'kind': 'chirp', 'frequency': 2.0, 'highest': 50.0, 'law': law})
    samples = chirp.sample(np.array([0.0, 5.0, 10.0]))
    middle = 26.0 if law == 'linear' else 10.0
    np.testing.assert_allclose(samples.frequency, [2.0, middle, 50.0])


def test_stairs_hold_their_levels() -> None:
    stairs = staircase(1.0, 2, hold=1.0, rise=0.2, offset=10.0)
    held = stairs.sample(np.arange(0, stairs.duration) + 0.5).value - 10.0
    np.testing.assert_allclose(held, [0, 0.5, 1, 0.5, 0, -0.5, -1, -0.5, 0])


def test_a_step_jumps_at_its_time_and_not_before() -> None:
    step = step_and_hold(2.0, 3.0, delay=1.0)
    np.testing.assert_array_equal(
        step.sample(np.array([0.0, 0.999, 1.0, 2.9])).value, [0, 0, 2, 2]
    )


def test_reversal_curves_turn_at_spread_points_and_come_back() -> None:
    curves = reversal_curves(1.0, 3, rate=4.0)
    values = np.array(curves.values)
    np.testing.assert_allclose(values[[0, -1]], 0.0)
    np.testing.assert_allclose(values[2:-1:2], [-1.0, -0.5, 0.0, 0.5])
    np.testing.assert_allclose(values[1:-1:2], 1.0)
    assert np.abs(curves.sample(np.linspace(0.01, curves.duration - 0.01, 99)).velocity).max() == 4


def test_a_sequence_continues_where_the_previous_part_ended() -> None:
    sequence = Sequence((Sine(1.0, 2.0, 1.25), Sine(1.0, 3.0, 2.0)))
    before = sequence.sample(np.array([1.25 - 1e-9]))
    after = sequence.sample(np.array([1.25]))
    assert sequence.duration == 3.25
    assert after.phase[0] == pytest.approx(before.phase[0], abs=1e-7)
    assert after.value[0] == pytest.approx(0.0)
    assert after.frequency[0] == 3.0


def test_composites_know_their_common_frequency() -> None:
    samples = from_spec({'kind': 'composite_zhou2021_low'}).sample(np.array([0.05]))
    assert samples.frequency[0] == pytest.approx(10.0)


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
