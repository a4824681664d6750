"""The signature of every effect, measured from the output alone: order, sign, amplitude, rate."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from sim_effect_plants import held, plant
from sim_signals import degrees, harmonics, loop_area, response, sine

from piezo_sim import Plant

# -- input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('f', [1.0, 7.0, 23.0])
def test_electrostriction_gives_mean_and_second_harmonic_with_the_square(f: float) -> None:
    p = plant('electrostriction', electrostriction__coefficient=0.04)
    full, half = response(p, f, 1.0), response(p, f, 0.5)
    assert full[0].real == pytest.approx(2e-6)
    assert abs(full[2]) == pytest.approx(2e-6)
    # sin^2 = (1 - cos 2wt) / 2: -90 degrees, and the hold delays by a sample.
    assert degrees(full[2] * np.exp(4j * np.pi * f / 1000)) == pytest.approx(-90, abs=0.1)
    assert abs(half[2] / full[2]) == pytest.approx(0.25)
    assert np.abs(full[3:]).max() < 1e-12


def test_delay_shifts_the_phase_in_proportion_to_the_frequency_and_nothing_else() -> None:
    p, straight = plant('transport_delay', amplifier__delay=0.0042), Plant()
    for f in (5.0, 20.0, 40.0):
        ratio = response(p, f)[1] / response(straight, f)[1]
        assert degrees(ratio) == pytest.approx(-360 * f * 0.004, abs=0.01)  # whole samples
        assert abs(ratio) == pytest.approx(1.0)


def test_dead_time_grows_with_the_amplitude() -> None:
    p = plant('amplitude_dead_time', amplifier__delay_per_volt=5e-3)
    lags = [-degrees(response(p, 10.0, a)[1]) for a in (0.25, 1.0)]
    assert lags[1] > 2.0 * lags[0] > 0
    spectrum = np.abs(response(p, 10.0, 1.0))
    assert spectrum[3] > 0.01 * spectrum[1]


def test_amplifier_lag_is_a_low_pass() -> None:
    p = plant('amplifier_lag', amplifier__lag_time_constant=2e-3, rate=20_000.0)
    for f in (20.0, 100.0):
        ratio = response(p, f)[1] * np.exp(1j * np.pi * f / p.rate) / 1e-4
        exact = 1 / (1 + 2j * math.pi * f * 2e-3)
        assert abs(ratio) == pytest.approx(abs(exact), rel=2e-3)
        assert degrees(ratio) == pytest.approx(degrees(exact), abs=0.2)


def test_saturation_cuts_the_tips_beyond_its_level_only() -> None:
    p = plant('saturation', amplifier__clip_low=-0.9, amplifier__clip_high=0.9)
    assert np.abs(response(p, 7.0, 0.85)[2:]).max() < 1e-12
    spectra = [np.abs(response(p, f, 1.0)) for f in (1.0, 7.0, 20.0)]
    for spectrum in spectra:
        assert spectrum[3] == pytest.approx(spectra[0][3], rel=0.03)  # no frequency in it
        assert spectrum[3] > 10 * spectrum[2]
    assert np.abs(held(p, 7.0)[0]).max() == pytest.approx(0.9e-4)


def test_slew_limit_bites_above_a_rate_and_limits_the_slope() -> None:
    p = plant('slew_limit', amplifier__slew_rate=60.0)
    slow, fast = held(p, 5.0)[0], held(p, 40.0)[0]
    assert np.abs(np.abs(response(p, 5.0))[2:]).max() < 1e-12
    assert np.abs(np.diff(slow)).max() < 60.0 * 1e-4 / 1000
    assert np.abs(np.diff(fast)).max() == pytest.approx(60.0 * 1e-4 / 1000)
    spectrum = np.abs(response(p, 40.0))
    assert spectrum[3] > 0.05 * spectrum[1]


def test_dac_moves_in_steps() -> None:
    p = plant('dac_quantisation', amplifier__resolution=0.02)
    steps = held(p, 3.0)[0] / (0.02 * 1e-4)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)


# -- ceramic -------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', ['bouc_wen', 'play', 'preisach'])
def test_hysteresis_opens_a_lagging_loop_of_odd_harmonics_at_any_rate(law: str) -> None:
    p = plant(law)
    areas = []
    for f in (1.0, 10.0, 25.0):
        reading, voltage = held(p, f)
        areas.append(np.sum(reading * np.gradient(voltage)) / f)
        spectrum = response(p, f)
        assert degrees(spectrum[1]) < -2
        assert abs(spectrum[3]) > 5e-7
        assert abs(spectrum[2]) < 2e-8
    assert areas[0] < 0  # the reading lags, so energy is lost
    np.testing.assert_allclose(areas, areas[0], rtol=0.02)


def test_asymmetry_adds_even_harmonics_with_its_sign_and_builds_up_with_the_travel() -> None:
    spectra = {a: response(plant('asymmetry', 'bouc_wen', bouc_wen__asymmetry=a), 7.0)
               for a in (-0.1, 0.0, 0.1)}  # fmt: skip
    assert abs(spectra[0.0][2]) < 1e-9
    for a in (-0.1, 0.1):
        assert np.sign(spectra[a][0].real) == -np.sign(a)
        assert abs(spectra[a][2]) > 1e-7
    _, command = sine(5.0, seconds=2.0)
    means = [
        plant('asymmetry', 'bouc_wen', bouc_wen__asymmetry=a).run(command).reshape(10, -1).mean(1)
        for a in (0.1, 0.0)
    ]
    shift = means[0] - means[1]
    assert np.all(np.diff(shift) < 1e-12)
    assert abs(shift[0]) < 0.9 * abs(shift[-1])


@pytest.mark.parametrize('law', ['play', 'preisach'])
def test_asymmetry_of_the_other_laws_is_even_too(law: str) -> None:
    assert abs(response(plant('asymmetry', law), 7.0)[2]) > 1e-7
    assert abs(response(plant(law), 7.0)[2]) < 1e-9


def test_a_larger_exponent_makes_small_loops_thinner() -> None:
    """The loss of a small loop grows with amplitude^(n + 2)."""
    for n in (1.0, 2.0):
        p = plant('hysteresis_exponent', 'bouc_wen', bouc_wen__exponent=n)
        areas = []
        for a in (0.02, 0.04):
            reading, voltage = held(p, 1.0, a)
            areas.append(loop_area(voltage, reading))
        assert math.log2(areas[1] / areas[0]) == pytest.approx(n + 2.0, abs=0.15)


@pytest.mark.parametrize('law', ['bouc_wen', 'play', 'preisach'])
def test_rate_dependence_widens_the_loop_with_the_logarithm_of_the_rate(law: str) -> None:
    p = plant('rate_dependence', law, rate_dependence__widening=0.1, rate=10_000.0)
    areas = [loop_area(*held(p, f)[::-1]) / f for f in (5.0, 50.0, 500.0)]
    assert 1.1 * areas[0] < areas[1] < areas[2] / 1.05
    assert areas[2] - areas[1] == pytest.approx(areas[1] - areas[0], rel=0.3)


@pytest.mark.parametrize('law', ['bouc_wen', 'play', 'preisach'])
def test_rate_dependence_widens_the_loop_with_a_power_of_the_rate(law: str) -> None:
    numbers = {
        'rate_dependence__widening': 0.1,
        'rate_dependence__exponent': 0.5,
        'rate_dependence__memory': 0.3,
    }
    p = plant('rate_dependence', law, rate=10_000.0, **numbers)
    areas = [loop_area(*held(p, f)[::-1]) / f for f in (5.0, 20.0, 80.0)]
    assert areas[1] > 1.1 * areas[0]
    assert areas[2] - areas[1] == pytest.approx(2.0 * (areas[1] - areas[0]), rel=0.1)


def test_gain_decay_takes_off_amplitude_with_its_time_constant() -> None:
    p = plant('gain_decay', depolarisation__loss=0.2, depolarisation__time_constant=2.0)
    _, command = sine(10.0, seconds=10.0)
    reading = p.run(command)
    for start in (1.0, 3.0, 9.0):
        piece = reading[int(1000 * start) : int(1000 * start) + 100]
        expected = 1 - 0.2 * (1 - math.exp(-(start + 0.05) / 2.0))
        assert np.ptp(piece) / 2e-4 == pytest.approx(expected, rel=0.01)


def test_backlash_loses_its_width_whatever_the_amplitude() -> None:
    p = plant('backlash', backlash__half_width=2e-6)
    for a in (0.1, 0.5, 1.0):
        assert np.ptp(held(p, 5.0, a)[0]) == pytest.approx(2 * (a * 1e-4 - 2e-6), rel=1e-9)
    small, large = np.abs(response(p, 5.0, 0.1)), np.abs(response(p, 5.0, 1.0))
    assert small[3] / small[1] > 5 * large[3] / large[1]
    assert np.abs(held(p, 5.0, 0.015)[0]).max() < 1e-12


# -- structure -----------------------------------------------------------------------------------


@pytest.mark.parametrize('order', [3, 5])
def test_resonance_lifts_the_harmonic_that_meets_it(order: int) -> None:
    p = plant('resonance', 'play', structure__natural_frequency=69.0,
              structure__damping_ratio=0.02)  # fmt: skip
    peak = 69.0 / order
    grid = sorted({round(peak * k, 1) for k in (0.6, 0.8, 1.2, 1.5)} | {peak})
    size = {}
    for f in grid:
        p.reset()
        _, command = sine(f, seconds=20.0)
        size[f] = abs(harmonics(p.run(command), f, 8, seconds=10.0)[order])
    assert max(size, key=size.__getitem__) == peak
    assert size[peak] > 3 * size[grid[0]]


@pytest.mark.parametrize(('effect', 'mode'), [('second_mode', 2), ('third_mode', 3),
                                              ('fourth_mode', 4)])  # fmt: skip
def test_a_further_mode_resonates_at_its_frequency_with_its_share(effect: str, mode: int) -> None:
    values = {f'mode_{mode}__frequency': 300.0, f'mode_{mode}__share': 0.2,
              f'mode_{mode}__damping_ratio': 0.05}  # fmt: skip
    p = plant(effect, rate=100_000.0, **values)
    gains = {f: abs(response(p, f)[1]) / 1e-4 for f in (1.0, 30.0, 60.0, 300.0, 900.0)}
    assert gains[1.0] == pytest.approx(1.0, rel=1e-3)
    assert gains[300.0] == pytest.approx(abs(0.8 + 0.2 / (2j * 0.05)), rel=0.02)
    assert gains[900.0] == pytest.approx(0.8 - 0.2 / 8, rel=0.02)
    # Well below, its share of the in-phase response grows with the square of the frequency.
    assert (gains[60.0] - 1) / (gains[30.0] - 1) == pytest.approx(4.0, rel=0.1)


def test_stiffness_gives_a_third_harmonic_with_the_cube_of_the_amplitude() -> None:
    for sign in (1, -1):
        p = plant('stiffness', 'resonance', structure__natural_frequency=400.0,
                  structure__damping_ratio=0.5, structure__cubic=sign * 4e6)  # fmt: skip
        spectra = {a: response(p, 3.0, a) for a in (0.5, 1.0)}
        # x = w - c w^3 and sin^3 = (3 sin - sin 3) / 4
        assert spectra[0.5][3].real == pytest.approx(sign * 4e6 * (0.5e-4) ** 3 / 4, rel=0.1)
        assert abs(spectra[1.0][3] / spectra[0.5][3]) == pytest.approx(8.0, rel=0.2)
        assert abs(spectra[1.0][2]) < 1e-10


def test_a_load_lowers_frequency_by_its_mass_and_motion_by_its_spring() -> None:
    values = {'structure__natural_frequency': 100.0, 'structure__damping_ratio': 0.02,
              'structure__stiffness': 1e6}  # fmt: skip
    mass = 1e6 / (2 * math.pi * 100.0) ** 2
    p = plant('load', 'resonance', structure__load_mass=mass, structure__load_stiffness=0.0,
              **values)  # fmt: skip
    gains = {f: abs(response(p, f, 0.1, 6.0)[1]) for f in (1.0, 66.0, 71.0, 76.0, 100.0)}
    assert max(gains, key=gains.__getitem__) == 71.0  # 100 / sqrt(2)
    p = plant('load', 'resonance', structure__load_mass=0.0, structure__load_stiffness=1e6,
              **values)  # fmt: skip
    assert p.run(np.full(3000, 1.0))[-1] == pytest.approx(0.5e-4, rel=1e-6)


def test_friction_holds_small_motion_and_lets_large_motion_pass() -> None:
    p = plant('friction', 'resonance', friction__coulomb=2e-6, friction__presliding=2e-6,
              friction__stiction=1.0, structure__natural_frequency=300.0,
              structure__damping_ratio=0.7)  # fmt: skip
    gain = {a: abs(response(p, 2.0, a)[1]) / (a * 1e-4) for a in (0.002, 0.02, 1.0)}
    assert gain[0.002] == pytest.approx(0.5, abs=0.05)  # elastic: 1 / (1 + coulomb / presliding)
    assert gain[0.002] < gain[0.02] < gain[1.0]
    large, small = (np.abs(response(p, 2.0, a)) for a in (1.0, 0.1))
    assert small[3] / small[1] > 3 * large[3] / large[1]  # relative distortion falls
    assert degrees(response(p, 2.0, 1.0)[1]) < -1


def test_restoring_hysteresis_opens_a_loop_though_the_ceramic_is_straight() -> None:
    p = plant('restoring_hysteresis', 'resonance', structure__natural_frequency=300.0,
              structure__damping_ratio=0.7)  # fmt: skip
    straight = plant('resonance', structure__natural_frequency=300.0, structure__damping_ratio=0.7)
    areas = [loop_area(*held(q, 1.0)[::-1]) for q in (p, straight)]
    assert areas[0] > 5 * areas[1]
    assert abs(response(p, 1.0)[3]) > 1e-7 > abs(response(straight, 1.0)[3])


def test_amplitude_damping_lowers_the_peak_of_large_motion_only() -> None:
    values = {'structure__natural_frequency': 68.0, 'structure__damping_ratio': 0.015}
    p = plant('amplitude_damping', 'resonance', structure__quadratic_damping=200.0, **values)
    gains = [abs(response(p, 68.0, a, 4.0)[1]) / a / 1e-4 for a in (1e-4, 0.03, 1.0)]
    assert gains[0] == pytest.approx(1 / 0.03, rel=0.03)
    assert gains[0] > 1.2 * gains[1] > 3 * gains[2]


def test_parametric_excitation_makes_combination_tones() -> None:
    p = plant('parametric_excitation', 'resonance', structure__natural_frequency=200.0,
              structure__pump_frequency=31.0, structure__pump_depth=0.1)  # fmt: skip
    reading, _ = held(p, 7.0, 0.3, 4.0)
    lines = np.abs(np.fft.rfft(reading)) / 500
    assert lines[24] > 1e-7
    assert lines[38] > 1e-7
    assert lines[14] < 1e-9


def test_contact_acts_beyond_its_position_only() -> None:
    free, stopped = (
        plant(*on, 'resonance', structure__natural_frequency=200.0, structure__damping_ratio=0.7)
        for on in ((), ('contact',))
    )
    _, command = sine(2.0, 1.0, 1.0)
    before, after = free.run(command), stopped.run(command)
    inside = before < 5e-5
    np.testing.assert_allclose(after[inside], before[inside], atol=1e-6)
    assert before.max() - after.max() > 5e-6


def test_the_error_of_a_scale_repeats_with_its_pitch() -> None:
    p = plant('cyclic_error', sensor__cyclic_error=1e-6, sensor__cyclic_period=20e-6)
    levels = np.repeat(np.linspace(0.0, 0.6, 25), 2)  # at 100 um/V a pitch is 0.2 V
    reading = p.run(np.append(levels, 0.0))[1:][1::2]
    true = 1e-4 * levels[1::2]
    expected = true + 1e-6 * np.sin(2 * np.pi * true / 20e-6)
    np.testing.assert_allclose(reading, expected, atol=1e-12)


def test_self_heating_follows_the_mean_square_of_the_voltage_rate() -> None:
    p = plant('self_heating', heating__gain=0.05, heating__reference=100.0,
              heating__time_constant=1.0)  # fmt: skip
    _, command = sine(20.0, 1.0, 12.0)
    reading = p.run(command)
    first, last = (np.ptp(reading[k * 1000 : (k + 1) * 1000]) for k in (0, 11))
    square = 0.5 * (2 * np.pi * 20.0) ** 2 / 100.0**2  # mean square of the rate over the reference
    assert last / 2e-4 == pytest.approx(1.0 + 0.05 * square, rel=2e-3)
    assert first < last
    p.run(np.zeros(8000))
    assert np.ptp(p.run(command[:50])) == pytest.approx(2e-4, rel=2e-3)


# -- slow ----------------------------------------------------------------------------------------


def test_creep_follows_a_step_exponentially() -> None:
    p = plant('creep', creep__gain_1=0.1, creep__time_1=0.5, creep__gain_2=0.0, creep__gain_3=0.0)
    reading = p.run(np.full(4001, 1.0))[1:]
    time = np.arange(1, 4001) / 1000
    np.testing.assert_allclose(reading, 1e-4 * (1.1 - 0.1 * np.exp(-time / 0.5)), rtol=1e-9)


def test_log_creep_gains_the_same_in_every_decade_of_time() -> None:
    p = plant('log_creep', log_creep__gain=0.02, log_creep__start=0.05)
    reading = p.run(np.full(110_000, 1.0)) / 1e-4
    gained = [reading[int(1000 * 10 * t)] - reading[int(1000 * t)] for t in (0.2, 1.0, 5.0)]
    np.testing.assert_allclose(gained, 0.02, rtol=0.15)


@pytest.mark.parametrize('amplitude', [0.0, 0.5, 1.0])
def test_drift_is_the_same_whatever_the_drive(amplitude: float) -> None:
    p = plant('drift', drift__rate=0.3e-6, drift__warming=0.0)
    _, command = sine(5.0, amplitude, 4.0)
    means = p.run(command).reshape(4, -1).mean(axis=1)
    np.testing.assert_allclose(np.diff(means[1:]), 0.3e-6, rtol=1e-6)
    warm = plant('drift', drift__rate=0.0, drift__warming=2e-6, drift__warming_time=1.0)
    assert warm.run(np.zeros(10_000))[-1] == pytest.approx(2e-6, rel=1e-3)


def test_every_effect_has_a_signature_here() -> None:
    """A new effect without a test of its signature is noticed."""
    files = Path(__file__).parent.glob('test_sim_effects*.py')
    trees = [ast.parse(file.read_text(encoding='utf-8')) for file in files]
    words = {
        node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)
    }
    assert {row.name for row in Plant().effect_table} - words == set()


def test_offset_and_sensor_curvature_do_not_meet_the_resonance() -> None:
    """What curves the sensor gives the same second harmonic at fn / 2 as far below."""
    mode = {'structure__natural_frequency': 68.0, 'structure__damping_ratio': 0.015}
    assert plant('offset', sensor__offset=5e-6).exchange(0.0) == 5e-6
    sensor = plant('sensor_nonlinearity', 'resonance', sensor__quadratic=100.0,
                   sensor__cubic=0.0, **mode)  # fmt: skip
    ceramic = plant('electrostriction', 'resonance', **mode)
    growth = {}
    for name, p in (('sensor', sensor), ('ceramic', ceramic)):
        low, high = (response(p, f, 0.5, 4.0) for f in (2.0, 34.0))
        growth[name] = abs(high[2] / high[1] ** 2) / abs(low[2] / low[1] ** 2)
    assert growth['sensor'] == pytest.approx(1.0, rel=0.02)
    assert growth['ceramic'] > 10
    cubic = plant('sensor_nonlinearity', sensor__quadratic=0.0, sensor__cubic=1e6)
    assert response(cubic, 5.0)[3].real == pytest.approx(-1e6 * 1e-12 / 4, rel=1e-2)


def test_mains_hum_stands_at_its_frequency_and_not_at_the_harmonics_of_the_drive() -> None:
    p = plant('mains_hum', mains__amplitude=0.7e-6, mains__frequency=50.0)
    rest = np.abs(np.fft.rfft(p.run(np.zeros(1000)))) / 500
    assert rest[50] == pytest.approx(0.7e-6)
    assert rest[150] == pytest.approx(0.07e-6)
    assert np.abs(response(p, 7.0))[2:].max() < 1e-12


def test_floor_vibration_is_a_tone_without_harmonics() -> None:
    p = plant('floor_vibration', vibration__frequency=17.0)
    lines = np.abs(np.fft.rfft(p.run(np.zeros(1000)))) / 500
    assert lines[17] == pytest.approx(0.3e-6)
    assert np.delete(lines, 17).max() < 1e-12


def test_modulated_tone_has_sidebands() -> None:
    p = plant('modulated_tone', modulated_tone__frequency=113.0, modulated_tone__modulation=2.0)
    lines = np.abs(np.fft.rfft(p.run(np.zeros(1000)))) / 500
    np.testing.assert_allclose(lines[[111, 113, 115]], [0.25e-6, 0.5e-6, 0.25e-6], rtol=1e-6)


def test_noise_is_white_and_flicker_noise_falls_with_the_frequency() -> None:
    noises = {
        name: plant(name, seed=3).run(np.zeros(200_000)) for name in ('noise', 'flicker_noise')
    }
    for reading in noises.values():
        assert np.std(reading) == pytest.approx(20e-9, rel=0.1)
    for name, slope in (('noise', 0.0), ('flicker_noise', -1.0)):
        power = (np.abs(np.fft.rfft(noises[name].reshape(20, -1), axis=1)) ** 2).mean(axis=0)
        low, high = power[5:15].mean(), power[50:150].mean()  # 0.5 .. 1.5 and 5 .. 15 Hz
        assert math.log10(high / low) == pytest.approx(slope, abs=0.25)


def test_bursts_are_rare_and_loud() -> None:
    p = plant('noise_bursts', sensor__burst_interval=2.0, sensor__burst_duration=0.2, seed=1)
    loud = np.abs(p.run(np.zeros(100_000))) > 0.0
    assert loud.mean() == pytest.approx(0.2 / 2.2, rel=0.5)
    lengths = np.diff(np.flatnonzero(np.diff(loud.astype(int))))
    assert lengths.max() > 100


def test_quantisation_clipping_and_rate_limit_of_the_sensor() -> None:
    steps = held(plant('quantisation', sensor__resolution=3e-7), 3.0)[0] / 3e-7
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert held(plant('sensor_clipping', sensor__range=6e-5), 3.0)[0].max() == 6e-5
    slow, fast = (held(plant('rate_limit', sensor__rate_limit=5e-3), f)[0] for f in (5.0, 20.0))
    assert np.abs(np.diff(slow)).max() < 5e-6
    assert np.abs(np.diff(fast)).max() == pytest.approx(5e-6)


def test_sensor_bandwidth_is_a_low_pass() -> None:
    p = plant('sensor_bandwidth', 'resonance', sensor__bandwidth=80.0, rate=20_000.0,
              structure__natural_frequency=3000.0, structure__damping_ratio=1.0)  # fmt: skip
    assert abs(response(p, 80.0)[1]) == pytest.approx(1e-4 / math.sqrt(2), rel=2e-3)


def test_jitter_is_noise_that_grows_with_the_speed() -> None:
    p = plant('jitter', sensor__jitter=1e-4)
    straight = Plant()
    noise = [np.std(held(p, f)[0] - held(straight, f)[0]) for f in (0.0, 2.0, 20.0)]
    assert noise[0] == 0.0
    assert noise[1] == pytest.approx(1e-4 * 2 * math.pi * 2 * 1e-4 / math.sqrt(2), rel=0.15)
    assert noise[2] == pytest.approx(10 * noise[1], rel=0.1)


def test_dropouts_repeat_the_sample_before() -> None:
    p = plant('dropouts', sensor__dropout_probability=0.05)
    reading = held(p, 3.0, seconds=20.0, tail=19.0)[0]
    assert np.mean(np.diff(reading) == 0.0) == pytest.approx(0.05, abs=0.01)


def test_switching_jumps_between_two_states_with_hysteresis() -> None:
    p = plant('switching', switching__step=3e-6, switching__threshold=0.5)
    jump = p.run([0.4, 0.6, 0.4, -0.4, -0.6, -0.4, 0.4, 0.0]) - 1e-4 * np.array(
        [0.0, 0.4, 0.6, 0.4, -0.4, -0.6, -0.4, 0.4]
    )
    np.testing.assert_allclose(jump, [0, 0, 3e-6, 3e-6, 3e-6, 0, 0, 0], atol=1e-15)
    assert np.abs(held(p, 5.0, 0.3)[0] - held(Plant(), 5.0, 0.3)[0]).max() < 1e-15
