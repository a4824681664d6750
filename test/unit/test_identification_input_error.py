"""The error of a recorded input is estimated and removed; what the actuator felt is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import piezo_hysteresis as ph
from piezo_hysteresis.identification.input_error import InputError, input_error
from piezo_hysteresis.identification.measurement import as_measured
from piezo_hysteresis.records import Record

RATE, COUNT = 1000.0, 4000
TIME = np.arange(COUNT) / RATE


def plays(voltage: np.ndarray) -> np.ndarray:
    """Return the displacement of ten plays from rest, of 15 um at 100 V [m]."""
    levels, y = np.zeros(10), np.empty(voltage.size)
    widths = np.linspace(2.0, 40.0, 10)
    for k, u in enumerate(voltage):
        levels = np.clip(levels, u - widths, u + widths)
        y[k] = 1.1e-7 * u + 4e-9 * levels.sum()
    return y + 5e-9 * np.random.default_rng(1).standard_normal(voltage.size)


DRIVES: dict[str, np.ndarray] = {
    'sine': 50.0 * (1.0 - np.cos(2 * np.pi * 3.0 * TIME)),
    'decay': 50.0 + 50.0 * np.exp(-TIME / 3.0) * np.sin(2 * np.pi * 2.0 * TIME),
    'multisine': 50.0
    + 6.0 * np.sum([np.cos(2 * np.pi * f * TIME + f**2) for f in (1, 2, 5, 9, 23)], 0),
}
EXACT = DRIVES | {
    'triangle': 100.0 * np.abs((2.0 * TIME + 1.0) % 2.0 - 1.0),
    'stairs': np.repeat(np.random.default_rng(3).uniform(0, 100, 40), 100),
    'chirp': 50.0 * (1.0 - np.cos(2 * np.pi * (1.0 + 4.0 * TIME) * TIME)),
    'switching': 80.0 * np.repeat(np.random.default_rng(4).integers(0, 2, 400), 10),
    'random': 50.0 + 10.0 * np.random.default_rng(5).standard_normal(COUNT),
}


def spoilt(u: np.ndarray, kind: str, size: float) -> np.ndarray:
    """Return the drive as a monitor reads it, with an error of `size` of its range."""
    size *= float(np.ptp(u))
    noise = size * np.random.default_rng(7).standard_normal(u.size)
    if kind == 'mains':
        return np.asarray(u + sqrt2 * size * np.sin(2 * np.pi * 50.0 * TIME + 1.0) + 0.2 * noise)
    if kind == 'steps':
        step = np.sqrt(12.0) * size
        return np.asarray(np.round(u / step) * step)
    if kind == 'held':
        return (u + noise)[np.arange(u.size) // 10 * 10]
    return u + noise


sqrt2 = np.sqrt(2.0)


def found_in(u: np.ndarray, felt: np.ndarray) -> InputError | None:
    return input_error(u, plays(felt), 1.0 / RATE)


@pytest.mark.parametrize('drive', EXACT)
def test_a_command_has_no_error(drive: str) -> None:
    assert found_in(EXACT[drive], EXACT[drive]) is None


def test_a_drive_that_repeats_is_no_noise_although_the_displacement_lags() -> None:
    u = np.tile(10.0 * np.random.default_rng(6).standard_normal(COUNT // 5), 5)
    moved = 1e-7 * np.asarray(lfilter([1e-3], [1.0, -1.9, 0.901], u))
    moved += 5e-9 * np.random.default_rng(1).standard_normal(COUNT)
    assert input_error(u, moved, 1.0 / RATE) is None
    noise = 0.05 * np.random.default_rng(7).standard_normal(COUNT)
    found = input_error(u + noise, moved, 1.0 / RATE)
    assert found is not None
    assert found.rms == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize('line', [50.0, 101.0, 150.0])
@pytest.mark.parametrize('mode', [20.0, 48.0, 240.0])
def test_a_line_of_the_drive_near_the_mains_is_no_hum(line: float, mode: float) -> None:
    """The displacement follows it, in whatever phase, or it is off the mains."""
    lines = [1.0, 2.3, 5.1, 23.0, line]
    u = np.sum([np.sin(2 * np.pi * f * TIME + f**2) for f in lines], 0)
    turn = 2 * np.pi * mode / RATE
    damped = [1.0, -2.0 * np.exp(-0.01 * turn) * np.cos(turn), np.exp(-0.02 * turn)]
    moved = 1e-7 * np.asarray(lfilter([float(np.sum(damped))], damped, u))
    moved += 1e-10 * np.random.default_rng(1).standard_normal(COUNT)
    assert input_error(u, moved, 1.0 / RATE) is None


FAST: dict[str, Callable[[int, np.random.Generator], np.ndarray]] = {
    'white': lambda n, rng: rng.standard_normal(n),
    'filtered': lambda n, rng: np.convolve(rng.standard_normal(n), np.ones(30) / 6.0, 'same'),
    'held': lambda n, rng: np.repeat(rng.standard_normal(n // 8), 8),
    'binary': lambda n, rng: np.repeat(rng.choice([-1.0, 1.0], n // 4), 4),
    'chirp': lambda n, rng: np.sin(2 * np.pi * 0.2 * np.arange(n) ** 2 / n),
}


@pytest.mark.parametrize('kind', FAST)
@pytest.mark.parametrize('mode', [45.0, 75.0, 120.0])
def test_a_fast_command_is_no_error_although_a_mode_passes_little(kind: str, mode: float) -> None:
    u = 50.0 + 10.0 * FAST[kind](5 * COUNT, np.random.default_rng((3, int(mode))))
    turn = 2 * np.pi * mode / RATE
    damped = [1.0, -2.0 * np.exp(-0.01 * turn) * np.cos(turn), np.exp(-0.02 * turn)]
    moved = np.asarray(lfilter([float(np.sum(damped))], damped, 1e-7 * u))
    moved += 1e-9 * np.random.default_rng(1).standard_normal(u.size)
    assert input_error(u, moved, 1.0 / RATE) is None


@pytest.mark.parametrize('kind', ['white', 'steps', 'held'])
@pytest.mark.parametrize('drive', ['sine', 'chirp'])
def test_what_the_actuator_felt_is_no_error(drive: str, kind: str) -> None:
    given = spoilt(EXACT[drive], kind, 2e-3)
    assert found_in(given, given) is None


@pytest.mark.parametrize('kind', ['white', 'mains', 'steps', 'held'])
@pytest.mark.parametrize('drive', DRIVES)
def test_an_error_is_removed_but_for_what_is_stated(drive: str, kind: str) -> None:
    u = DRIVES[drive]
    given = spoilt(u, kind, 2e-3)
    found = found_in(given, u)
    assert found is not None
    error = float(np.std(given - u))
    left = float(np.sqrt(np.mean((found.voltage - u) ** 2)))
    assert found.rms == pytest.approx(error, rel=0.15)
    assert left < 0.5 * error
    assert left < 2.0 * found.left.rms + 1e-4 * np.ptp(u)
    assert found.hold == (10 if kind == 'held' else 1)
    assert bool(found.hum) == (kind == 'mains')


@pytest.mark.component
def test_parameters_are_not_biased_by_the_error_of_the_input() -> None:
    u = DRIVES['sine']
    clean = Record('a', 1.0 / RATE, u, plays(u))
    one = ph.identify(clean, 'prandtl_ishlinskii')
    assert not any('measured, not commanded' in each for each in one.warnings)
    known = [name for name, std in one.std.items() if std < np.inf]
    away = []
    for seed in (7, 8, 9):
        error = 5e-3 * np.ptp(u) * np.random.default_rng(seed).standard_normal(u.size)
        two = ph.identify(replace(clean, voltage=u + error), 'prandtl_ishlinskii')
        assert any('measured, not commanded' in each for each in two.warnings)
        deviation = {name: np.hypot(one.std[name], two.std[name]) for name in known}
        away.append([(two.values[n] - one.values[n]) / deviation[n] for n in known])
    assert np.max(np.abs(np.mean(away, axis=0))) < 1.0
    assert two.std['offset'] > 1.5 * one.std['offset']
    assert np.max(np.abs(away)) < 2.0
    again, _ = as_measured(as_measured([replace(clean, voltage=u + error)])[0])
    assert again[0].input_uncertainty is not None


def test_a_voltage_that_nothing_follows_is_constant() -> None:
    u = DRIVES['sine']
    driven = Record('a', 1.0 / RATE, u, plays(u))
    noise = 50.0 + 0.2 * np.random.default_rng(3).standard_normal(u.size)
    resting = Record('rest', 1.0 / RATE, noise, plays(0.0 * u + 50.0))
    small = Record('small', 1.0 / RATE, 50.0 + 0.05 * u, plays(50.0 + 0.05 * u))
    found, remarks = as_measured([driven, resting, small])
    assert np.ptp(found[1].voltage) == 0.0
    assert found[0] is driven
    assert found[2] is small
    assert [each for each in remarks if 'rest' in each]


def test_each_record_is_simulated_also_one_with_a_hardly_known_voltage() -> None:
    u = DRIVES['sine']
    driven = Record('a', 1.0 / RATE, u, plays(u))
    felt = 0.4 * DRIVES['decay']
    vague = Record('b', 1.0 / RATE, spoilt(felt, 'white', 0.2), plays(felt))
    assert [record.name for record in as_measured([driven, vague])[0]] == ['a']
    model = ph.identify(driven, 'prandtl_ishlinskii')
    runs = ph.simulate(model, [driven, vague])
    assert [run.size for run in runs] == [COUNT, COUNT]


@pytest.mark.component
def test_an_online_method_states_that_its_deviations_lack_the_error_of_the_input() -> None:
    u = DRIVES['sine']
    error = 5e-3 * np.ptp(u) * np.random.default_rng(7).standard_normal(u.size)
    command, monitor = (
        Record('a', 1.0 / RATE, u, plays(u)),
        Record('a', 1.0 / RATE, u + error, plays(u)),
    )
    sentence = 'do not contain the error of the measured voltage'
    by_rls = [ph.identify(each, 'classical', method='rls') for each in (command, monitor)]
    assert [any(sentence in line for line in found.warnings) for found in by_rls] == [False, True]


def test_the_error_of_a_fitted_drive_is_as_large_as_stated() -> None:
    """Median over draws of the square over the stated one; .84 by chance of four terms."""
    time, ratios = np.arange(3000) / 1000.0, []
    for seed in range(24):
        generator = np.random.default_rng(seed)
        u = np.sin(2 * np.pi * 30.0 * time + generator.uniform(-3.0, 3.0))
        y = 1e-4 * u + 4e-8 * generator.standard_normal(u.size)
        readings = u + 6e-3 * generator.standard_normal(u.size)
        found = input_error(readings[np.arange(u.size) // 10 * 10], y, 1e-3)
        assert found is not None
        ratios.append(float(np.mean((found.voltage - u) ** 2)) / found.left.rms**2)
    assert 0.6 < np.median(ratios) < 1.1


@pytest.mark.parametrize('kind', ['white', 'mains'])
@pytest.mark.parametrize('height', [0.0, 80.0])
def test_a_voltage_at_rest_is_constant_although_its_recording_is_not(
    height: float, kind: str
) -> None:
    """A hysteresis adds up what is left of noise: what rests must not move at all."""
    felt = np.where(TIME < 0.5, 0.0, height)
    u = felt + (spoilt(DRIVES['sine'], kind, 1e-3) - DRIVES['sine'])
    found = found_in(u, felt)
    assert found is not None
    rest = found.voltage[TIME > 1.0]
    assert np.sum(np.abs(np.diff(rest))) < 1e-2 * np.sum(np.abs(np.diff(u[TIME > 1.0])))
    assert np.max(np.abs(found.voltage - felt)) < 5e-3 * np.ptp(DRIVES['sine'])
    assert np.sqrt(np.mean((rest - height) ** 2)) < 3.0 * found.left.rms


def test_a_record_at_rest_with_a_noisy_recording_of_its_voltage_is_kept() -> None:
    rng = np.random.default_rng(2)
    moving = Record('sine', 1.0 / RATE, DRIVES['sine'], plays(DRIVES['sine']))
    rest = Record(
        'rest', 1.0 / RATE, 0.1 * rng.standard_normal(COUNT), 5e-9 * rng.standard_normal(COUNT)
    )
    found, remarks = as_measured([moving, rest])
    assert [each.name for each in found] == ['sine', 'rest']
    assert np.ptp(found[1].voltage) < 0.02
    assert any(each.startswith('record rest: the voltage was measured') for each in remarks)


@pytest.mark.parametrize('frequency', [10.0, 47.0])
def test_hum_on_a_line_of_the_drive_is_known_from_another_record(frequency: float) -> None:
    """A line of 50 Hz of a drive of 10 Hz looks like drive; other records show that it is hum."""
    hum = 0.2 * np.sin(2 * np.pi * 50.0 * TIME + 1.0)
    drives = [50.0 * (1.0 - np.cos(2 * np.pi * f * TIME)) for f in (3.0, frequency)]
    noise = np.random.default_rng(3).standard_normal((2, COUNT))
    records = [
        Record(f'{k}', 1.0 / RATE, u + hum + 0.02 * noise[k], plays(u))
        for k, u in enumerate(drives)
    ]
    found, remarks = as_measured(records)
    for each, u in zip(found, drives, strict=True):
        line = np.mean((each.voltage - u) * np.exp(-2j * np.pi * 50.0 * TIME))
        assert 2.0 * abs(line) < 0.1 * 0.2
    sentence = 'at 50 Hz in the voltage, as in the other records, is hum'
    assert any(sentence in each for each in remarks)
    alone = as_measured(records[1:])[0][0].voltage - drives[1]
    assert np.std(alone) > 0.5 * np.std(hum)


def test_a_line_of_the_drive_itself_is_not_taken_for_hum() -> None:
    hum = 0.2 * np.sin(2 * np.pi * 50.0 * TIME + 1.0)
    noise = 0.02 * np.random.default_rng(3).standard_normal((2, COUNT))
    slow = 50.0 * (1.0 - np.cos(2 * np.pi * 3.0 * TIME))
    own = slow + 2.0 * np.sin(2 * np.pi * 50.0 * TIME)
    records = [
        Record('slow', 1.0 / RATE, slow + hum + noise[0], plays(slow)),
        Record('own', 1.0 / RATE, own, plays(own)),
    ]
    found, _ = as_measured(records)
    assert np.array_equal(found[1].voltage, own)


def held(u: np.ndarray, size: float, seed: int = 7) -> np.ndarray:
    """Return a drive as a monitor of 100 Hz reads it, with noise of `size` of its range."""
    noise = size * np.ptp(u) * np.random.default_rng(seed).standard_normal(u.size)
    return np.asarray((u + noise)[np.arange(u.size) // 10 * 10])


def test_a_drive_of_nearly_half_the_rate_of_its_monitor_is_found_again() -> None:
    u = np.sin(2 * np.pi * 47.0 * TIME)
    found = found_in(held(u, 1e-3), u)
    assert found is not None
    assert not found.skipped
    assert np.std(found.voltage - u) < 1e-3 * np.ptp(u)


QUICK = {
    'step': np.where(TIME < 1.3037, 0.0, 80.0),
    'corners': 50.0 * np.abs((2.0 * TIME**1.5 + 1.003) % 2.0 - 1.0),
    'alias': 50.0 * (1.0 - np.cos(2 * np.pi * 120.0 * TIME)),
}


@pytest.mark.parametrize('drive', QUICK)
@pytest.mark.parametrize('size', [1e-4, 1e-3])
def test_what_a_held_monitor_does_not_show_is_left_out_of_a_set(drive: str, size: float) -> None:
    """A held step was taken for an exact command, and its noise moved the hysteresis."""
    u = QUICK[drive]
    slow = Record('slow', 1.0 / RATE, held(DRIVES['sine'], size), plays(DRIVES['sine']))
    quick = Record('quick', 1.0 / RATE, held(u, size), plays(u))
    kept, remarks = as_measured([slow, quick])
    assert [each.name for each in kept] == ['slow']
    assert any('record quick is left out' in each for each in remarks)
    alone = as_measured([quick])[0][0]
    assert alone.input_uncertainty is not None
    assert np.max(np.abs(alone.voltage)) < 101.0  # a spline overshoots at a step


def test_the_values_at_which_a_noisy_drive_turns_are_not_cut_off() -> None:
    u = 100.0 * np.abs((TIME + 0.6) ** 1.2 % 2.0 - 1.0)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(u)))) + 1
    outward = -np.sign(np.diff(u)[turns])
    errors = []
    for seed in range(100, 120):
        noise = 0.2 * np.random.default_rng(seed).standard_normal(COUNT)
        found = found_in(u + noise, u)
        assert found is not None
        errors.append(outward * (found.voltage - u)[turns])
    assert abs(np.mean(errors)) < 0.05


@pytest.mark.component
@pytest.mark.parametrize('kind', ['mains', 'white'])
def test_the_smallest_noise_does_not_move_what_rests_for_long(kind: str) -> None:
    """1e-5 of the range at rest moved a hysteresis by a tenth of it, which was named creep."""
    felt = np.tile(np.where(TIME < 0.5, 0.0, 80.0), 3)[500 : 3 * COUNT - 3000]
    noise = 1e-5 * 80.0 * np.random.default_rng(7).standard_normal(felt.size)
    hum = 8e-3 * np.sin(2 * np.pi * 50.0 / RATE * np.arange(felt.size)) if kind == 'mains' else 0.0
    record = Record('a', 1.0 / RATE, felt + noise + hum, plays(felt))
    [found], remarks = as_measured([record])
    path, exact = (np.sum(np.abs(np.diff(u))) for u in (found.voltage, felt))
    assert path < 1.01 * exact
    assert bool(remarks) == (kind == 'mains')


def test_a_curve_with_corners_and_a_held_monitor_is_measured() -> None:
    """Its corners are as fast as noise of the readings, and the displacement follows them."""
    levels = np.outer(2.5 * np.arange(1, 20), [1.0, -1.0]).ravel()
    times = np.cumsum(np.abs(np.diff(levels, prepend=0.0))) / 100.0
    u = np.interp(np.arange(0.0, times[-1], 1.0 / RATE), times, levels)
    found = found_in(held(u, 6e-4), u)
    assert found is not None
    assert found.hold == 10


def test_the_error_of_levels_that_were_fitted_moves_with_the_voltage_only() -> None:
    """A hysteresis adds up all changes: an error that moves at rest made deviations 80 times."""
    error = ph.records.record.InputUncertainty(1e-3, colour=0.95)
    drawn = error.draw(EXACT['stairs'], 1, np.random.default_rng(1))
    levels = drawn.reshape(40, 100)
    assert np.ptp(levels, axis=1).max() == 0.0
    assert float(np.std(levels[:, 0])) == pytest.approx(1e-3, rel=0.4)
    noise = replace(error, colour=0.0)  # what is still in the voltage moves at rest, too
    drawn = noise.draw(EXACT['stairs'], 1, np.random.default_rng(1))
    assert float(np.std(np.diff(drawn))) == pytest.approx(sqrt2 * 1e-3, rel=0.1)


@pytest.mark.component
def test_a_converter_reads_all_records_of_one_reach_wrong_by_the_same_share() -> None:
    """The rounding of six sines was averaged: the gain was off by four stated deviations."""
    records = []
    for k, f in enumerate((1.0, 2.0, 5.0, 7.0, 11.0, 13.0)):
        u = 50.0 * np.sin(2 * np.pi * f * TIME)
        noise = 1e-9 * np.random.default_rng(k).standard_normal(u.size)
        read = np.round(u / 4.0) * 4.0
        records.append(Record(f'sine_{f:g}', 1 / RATE, read, 1e-7 * u + noise))
    found = ph.identify(records, 'gain')
    off = abs(found.values['A1'] - 1e-7)
    assert off == pytest.approx(9.3e-10, rel=0.1)
    assert off < 2.0 * found.std['A1'] < 2e-9
