"""Every kind of waveform through the same list of checks, then what each promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms import (
    KINDS,
    Multisine,
    Sequence,
    Sine,
    WaveformError,
    from_spec,
    reversal_curves,
    staircase,
    step_and_hold,
)

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
