"""The parts of the excitation node that know no ROS."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.parameters.node_tables import EXCITATION
from piezo_hysteresis.runtime.excitation_plan import Experiment
from piezo_hysteresis.runtime.sweep_plan import Sweep, parse_options, waveform_of
from piezo_hysteresis.waveforms import KINDS, Sine, from_spec

RATE = 1000.0


def test_a_change_of_waveform_is_smooth_and_its_derivatives_are_true() -> None:
    experiment = Experiment(Sine(1e-4, 5.0, 10.0), first=7, rate=RATE)
    experiment.change(Sine(2e-4, 8.0, 10.0, offset=1e-5), sample=307, length=0.2)
    later = {'kind': 'chirp', 'amplitude': 5e-5, 'frequency': 3.0, 'highest': 6.0}
    experiment.change(from_spec(later), sample=407, length=0.1)
    points = np.array([experiment.point(7 + k)[1:4] for k in range(700)])
    value, velocity, acceleration = points.T
    inner = slice(1, -1)
    np.testing.assert_allclose(np.gradient(value, 1e-3)[inner], velocity[inner], atol=3e-5)
    np.testing.assert_allclose(np.gradient(velocity, 1e-3)[inner], acceleration[inner], atol=5e-3)
    assert np.abs(velocity).max() > 5e-3
    expected = from_spec(later).sample(np.array([0.25])).value[0]
    assert experiment.point(7 + 400 + 250).displacement == expected


def test_a_second_change_begins_where_the_first_one_is() -> None:
    experiment = Experiment(Sine(1e-4, 5.0, 10.0), first=0, rate=RATE)
    experiment.change(Sine(1e-4, 5.0, 10.0, offset=1e-3), sample=300, length=0.2)
    before = [experiment.point(k).displacement for k in range(300, 401)]
    experiment.change(Sine(1e-4, 5.0, 10.0, offset=-1e-3), sample=400, length=0.2)
    assert experiment.point(400).displacement == pytest.approx(before[-1], abs=1e-12)
    assert 2e-4 < before[-1] < 8e-4  # under way


def test_the_phase_of_a_sine_is_continuous_over_a_change_of_frequency() -> None:
    experiment = Experiment(Sine(1.0, 5.0, 10.0), first=0, rate=RATE)
    points = [experiment.point(k) for k in range(317)]
    experiment.change(Sine(1.0, 9.0, 10.0), sample=317, length=0.0)
    points += [experiment.point(k) for k in range(317, 700)]
    turned = np.diff([each.phase for each in points])
    assert np.abs(turned).max() <= 2 * np.pi * 9.0 / RATE * (1 + 1e-9)
    moved = np.diff([each.displacement for each in points])
    assert np.abs(moved).max() <= 2 * np.pi * 9.0 / RATE * (1 + 1e-9)


@pytest.mark.parametrize('kind', [name for name in KINDS if name != 'sequence'])
def test_every_waveform_makes_a_sweep(kind: str) -> None:
    sweep = Sweep([2.0], [0.5], 1.0, RATE, waveform=kind)
    expected = waveform_of(kind, {'frequency': 2.0, 'amplitude': 0.5, 'duration': 1.0}, {}, RATE)
    time = np.arange(1000.0) * (1.0 / RATE)
    np.testing.assert_array_equal(sweep.records[0].voltages, expected.sample(time).value)


def test_a_sweep_ends_and_is_cancelled_at_rest() -> None:
    sweep = Sweep([3.0, 7.0], [0.4, 1.0], 0.5, RATE, pause=0.05)
    sweep.start(100)
    voltage = np.array([sweep.voltage(100 + k) for k in range(sweep.length)])
    assert voltage[-1] == 0.0
    assert sweep.over(100 + sweep.length)
    fastest = 2 * np.pi * 7.0 * 1.0 / RATE
    assert np.abs(np.diff(voltage)).max() <= fastest
    sweep.cancel(900)
    assert not sweep.over(900)
    tail = [sweep.voltage(899 + k) for k in range(102)]
    assert tail[-1] == 0.0
    assert np.abs(np.diff(tail)).max() <= fastest
    assert sweep.over(1000)


@pytest.mark.parametrize('text', ['[1, 2]', '3', 'a: [', '{1: 2}', '!!python/object:os.system {}'])
def test_options_that_are_no_mapping_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(PiezoError) as caught:
        parse_options(text)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('frequencies', 'amplitudes', 'seconds', 'options'),
    [
        ([], [1.0], 1.0, {}),
        ([1.0], [], 1.0, {}),
        ([500.0], [1.0], 1.0, {}),
        ([1.0], [float('nan')], 1.0, {}),
        ([1.0], [1.0], 0.0, {}),
        ([1.0], [1.0], 1e9, {}),
        ([1.0], [1.0], 1.0, {'colour': 'red'}),
    ],
)
def test_impossible_sweeps_are_refused(
    frequencies: list[Any], amplitudes: Any, seconds: float, options: dict[str, Any]
) -> None:
    with pytest.raises(PiezoError):
        Sweep(frequencies, amplitudes, seconds, RATE, options=options)


def test_a_sweep_leaves_no_voltage_faster_than_it_moves() -> None:
    sweep = Sweep([1.0], [2.0], 3.0, RATE)
    fastest = 2.0 * np.pi * 1.0 * 2.0 / RATE * 1.001
    sweep.start(100, 5.0)
    first = [sweep.voltage(sample) for sample in range(100, 5000)]
    assert abs(first[0] - 5.0) < fastest
    assert np.max(np.abs(np.diff(first))) < fastest
    begins = next(k for k in range(100, 5000) if sweep.starting(k) is not None)
    np.testing.assert_array_equal(first[begins - 100 : begins - 97], sweep.records[0].voltages[:3])
    sweep.cancel(begins + 250)
    back = [sweep.voltage(sample) for sample in range(begins + 249, begins + 800)]
    assert np.max(np.abs(np.diff(back))) < fastest
    assert back[-1] == 0.0
    over = next(k for k in range(begins + 250, begins + 800) if sweep.over(k))
    assert sweep.voltage(over) == 0.0


def test_a_small_sweep_comes_down_as_slowly_as_it_moves() -> None:
    sweep = Sweep([1.0], [0.25], 3.0, RATE)
    sweep.start(100, 0.75)
    first = [sweep.voltage(sample) for sample in range(100, 5000)]
    assert np.max(np.abs(np.diff(first))) < 2.0 * np.pi * 0.25 / RATE * 1.001


def test_a_sweep_begins_at_once_where_it_would_not_jump() -> None:
    sweep = Sweep([10.0], [2.0], 1.0, 1000.0)
    sweep.start(7, 0.01)
    assert sweep.starting(7) is sweep.records[0]


@pytest.mark.parametrize('name', ['ramp', 'frequency', 'amplitude', 'offset'])
def test_no_value_of_the_waveform_leaves_numbers_that_are_not_finite(name: str) -> None:
    """Each setting at the ends of its range and at the least positive number, then restored."""
    usual = {'frequency': 10.0, 'amplitude': 5e-5, 'offset': 0.0, 'ramp': 1.0}
    key = name if name in ('ramp', 'frequency') else f'reference.{name}'
    spec = EXCITATION.spec(key)
    assert spec is not None
    for value in (spec.low, 5e-324, 1e-200, 1e-9, min(spec.high, 499.0)):
        changed = {**usual, name: value}
        if name == 'frequency' and value < 1e-6:
            with pytest.raises(PiezoError):
                waveform_of('sine', changed, {}, 1000.0)
            continue
        experiment = Experiment(waveform_of('sine', usual, {}, 1000.0), 0, 1000.0)
        experiment.change(waveform_of('sine', changed, {}, 1000.0), 10, changed['ramp'])
        during = [experiment.point(k) for k in (10, 11, 12, 100, 400)]
        experiment.change(waveform_of('sine', usual, {}, 1000.0), 500, usual['ramp'])
        after = [experiment.point(k) for k in (500, 501, 900, 1600, 3000)]
        assert np.isfinite([*during, *after]).all()
        direct = Experiment(waveform_of('sine', usual, {}, 1000.0), 0, 1000.0).point(3000)
        assert after[-1].displacement == pytest.approx(direct.displacement, abs=1.1e-4)


def test_a_new_waveform_leaves_one_that_is_not_finite() -> None:
    broken = Sine(float('nan'), 1.0, 10.0)
    experiment = Experiment(broken, 0, 1000.0)
    experiment.change(waveform_of('sine', {'frequency': 1.0, 'amplitude': 1.0}, {}, 1e3), 5, 0.1)
    assert np.isfinite([experiment.point(k) for k in (5, 6, 50, 500)]).all()
