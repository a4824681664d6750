"""The signature of every effect of the sensor, and of what is added to the motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sim_effect_plants import held, plant
from sim_signals import response

from piezo_sim import Plant


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
