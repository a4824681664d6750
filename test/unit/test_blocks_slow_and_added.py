"""Slow, sensor and added blocks against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block

DT = 1e-2


def respond(
    name: str,
    x: np.ndarray | list[Any],
    values: dict[Any, Any],
    dt: Any = DT,
    frequency: Any = 0.0,
    start: Any = 0.0,
) -> FloatArray:
    block = named_block(name)
    return block.respond(
        np.asarray(x, float), block.pack(values), dt, state=block.initial_state(dt, start),
        frequency=frequency,
    )  # fmt: skip


def test_creep_after_a_step_is_exponential() -> None:
    t = np.arange(1, 1001) * DT  # the ends of the ticks
    y = respond('creep', np.ones(1000), {'creep_share': 0.1, 'creep_time': 2.0})
    np.testing.assert_allclose(y, 1.0 + 0.1 * (1 - np.exp(-t / 2.0)), atol=1e-12)


def test_the_elements_of_a_pair_creep_side_by_side() -> None:
    t = np.arange(1, 1001) * DT
    values = {
        'creep_share': 0.1, 'creep_time': 0.2, 'slow_creep_share': 0.05, 'slow_creep_ratio': 20.0,
    }  # fmt: skip
    y = respond('creep_pair', np.ones(1000), values)
    expected = 1.0 + 0.1 * (1 - np.exp(-t / 0.2)) + 0.05 * (1 - np.exp(-t / 4.0))
    np.testing.assert_allclose(y, expected, atol=1e-12)


def test_logarithmic_creep_is_a_line_over_log_time() -> None:
    y = respond(
        'logarithmic_creep', np.ones(200_000), {'creep_per_decade': 0.02, 'creep_onset': 0.1}
    )
    t = np.arange(200_000) * DT
    late = t > 1.0
    expected = 1.0 + 0.02 * np.log10(1 + t / 0.1)
    assert np.abs(y - expected)[late].max() < 0.0015
    decade = np.interp([10.0, 100.0, 1000.0], t, y)
    np.testing.assert_allclose(np.diff(decade), 0.02, rtol=0.05)


def test_drift_and_warming() -> None:
    t = np.arange(500.0) * DT
    zero = np.zeros(500)
    np.testing.assert_allclose(respond('drift', zero, {'drift_rate': 1e-6}), 1e-6 * t)
    warm = respond('warming', zero, {'warming_shift': 2e-6, 'warming_time': 1.5})
    np.testing.assert_allclose(warm, 2e-6 * (1 - np.exp(-t / 1.5)), atol=1e-20)


def test_gain_decays_to_its_final_value() -> None:
    y = respond('gain_decay', np.ones(2000), {'gain_loss': 0.2, 'gain_loss_time': 1.0})
    assert y[0] == 1.0
    assert y[-1] == pytest.approx(0.8, abs=1e-6)
    forever = respond('gain_decay', np.ones(100), {'gain_loss': 1.0, 'gain_loss_time': 1.0})
    np.testing.assert_allclose(forever, np.exp(-np.arange(100) * DT), rtol=1e-12)


def test_hum_is_locked_to_the_time_of_the_record() -> None:
    values = {'hum_frequency': 50.0, 'hum_sine': 1e-7, 'hum_cosine': 3e-7}
    start, dt = 12.345, 1e-3
    y = respond('mains_hum', np.zeros(300), values, dt, start=start)
    angle = 2 * np.pi * 50.0 * (start + np.arange(300) * dt)
    np.testing.assert_allclose(y, 1e-7 * np.sin(angle) + 3e-7 * np.cos(angle), atol=1e-18)


@pytest.mark.parametrize('order', [3, 5])
def test_harmonics_are_locked_to_the_drive_and_silent_without_one(order: int) -> None:
    values = {f'sine{order}': 2e-6, f'cosine{order}': -1e-6}
    y = respond(f'harmonic{order}', np.zeros(400), values, 1e-3, frequency=14.0)
    angle = 2 * np.pi * order * 14.0 * np.arange(400) * 1e-3
    np.testing.assert_allclose(y, 2e-6 * np.sin(angle) - 1e-6 * np.cos(angle), atol=1e-17)
    assert not respond(f'harmonic{order}', np.zeros(50), values, 1e-3).any()


@pytest.mark.parametrize(
    ('block', 'order', 'names'),
    [('exogenous3', 3, ('c3', 'c4', 'al1', 'al2')), ('exogenous5', 5, ('c5', 'c6', 'al3', 'al4'))],
)
def test_exogenous_harmonics_follow_the_printed_recursion(
    block: str, order: int, names: tuple[str, ...]
) -> None:
    ca, cb, al_a, al_b = 0.2, -0.5, 1e-6, -2e-6
    values = dict(zip(names, (ca, cb, al_a, al_b), strict=True))
    y = respond(block, np.zeros(200), values, 1e-3, frequency=23.0)
    expected = [0.0, 0.0, 0.0]
    for k in range(200):
        angle = 2 * np.pi * order * 23.0 * k * 1e-3
        expected.append(
            expected[-1] + ca * expected[-2] + cb * expected[-3]
            + al_a * np.sin(angle) + al_b * np.cos(angle)
        )  # fmt: skip
    np.testing.assert_allclose(y, expected[3:], atol=1e-17)


@pytest.mark.parametrize('cubic', [1e-3, 1e6, 5e8])
def test_hardening_spring_balances(cubic: float) -> None:
    v = np.linspace(-3e-4, 3e-4, 41)
    x = respond('stiffness', v, {'cubic_stiffness': cubic})
    np.testing.assert_allclose(x + cubic * x**3, v, rtol=1e-12, atol=1e-20)


def test_softening_spring_balances_up_to_its_fold() -> None:
    cubic = -1e7
    fold = 1 / np.sqrt(3e7)
    v = np.linspace(0, 2 / 3 * fold, 50)
    x = respond('stiffness', v, {'cubic_stiffness': cubic})
    np.testing.assert_allclose(x + cubic * x**3, v, rtol=1e-9, atol=1e-18)
    assert respond('stiffness', [1.0], {'cubic_stiffness': cubic})[0] == pytest.approx(fold)


def test_backlash_and_stiction_differ_in_how_they_follow() -> None:
    ramp = np.linspace(0, 1e-5, 101)
    backlash = respond('backlash', ramp, {'backlash': 2e-6})
    np.testing.assert_allclose(backlash[30:], ramp[30:] - 2e-6)
    stiction = respond('stiction', ramp, {'stiction': 2.05e-6})
    assert np.unique(stiction).size == 5
    assert np.abs(stiction - ramp).max() <= 2.05e-6


def test_sensor_polynomial_and_square_laws() -> None:
    v = np.array([-2e-5, 0.0, 1e-5])
    y = respond('sensor_nonlinearity', v, {'sensor_quadratic': 100.0, 'sensor_cubic': 1e6})
    np.testing.assert_allclose(y, v + 100 * v**2 + 1e6 * v**3)
    u = np.array([-2.0, 0.0, 1.0])
    np.testing.assert_allclose(respond('square_law', u, {'square_law': 0.1}), u + 0.1 * u**2)
    np.testing.assert_allclose(
        respond('electrostriction', u, {'electrostriction': 1e-6}), 1e-6 * u**2
    )


def test_a_tone_is_found_with_a_larger_slow_residual() -> None:
    from piezo_hysteresis.blocks.effect import Residual
    from piezo_hysteresis.blocks.mains_hum import guess

    generator, dt, time = np.random.default_rng(4), 1e-3, 1e-3 * np.arange(8000)
    slow = 8e-7 * np.exp(-time / 0.3) * np.cos(2.0 * np.pi * 3.3 * time)
    tone = 5e-8 * np.sin(2.0 * np.pi * 41.3 * time + 0.4)
    residual = slow + tone + 1e-8 * generator.standard_normal(time.size)
    seen = Residual(np.zeros(time.size), np.zeros(time.size), residual, dt)
    first = guess(seen)[0]
    assert first['hum_frequency'] == pytest.approx(41.3, abs=0.02)
    assert np.hypot(first['hum_sine'], first['hum_cosine']) == pytest.approx(5e-8, rel=0.1)


def test_a_two_sided_sensor_curve_is_guessed_from_its_residual() -> None:
    from piezo_hysteresis.blocks.effect import Residual
    from piezo_hysteresis.blocks.sensor_two_sided import guess

    v = 1e-5 + 2e-5 * np.sin(0.01 * np.arange(2000))
    values = {'side_even': 300.0, 'side_odd': -700.0, 'side_centre': 1e-5}
    curved = respond('sensor_two_sided', v, values, 1e-3)
    found = guess(Residual(np.zeros(v.size), v, curved - v, 1e-3))[0]
    assert found == pytest.approx(values, rel=1e-6)
