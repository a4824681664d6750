"""Structure and input blocks against SciPy and against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.simulation.substep_sensitivities import (
    BlockPoint,
    propagate_derivatives,
)

DT = 1e-3


def respond(
    name: str,
    x: Any,
    values: dict[Any, Any],
    dt: Any = DT,
    frequency: float = 0.0,
    start: float = 0.0,
) -> FloatArray:
    block = named_block(name)
    return block.respond(
        np.asarray(x, float), block.pack(values), dt, state=block.initial_state(dt, start),
        frequency=frequency,
    )  # fmt: skip


def pulse(n: int = 400) -> FloatArray:
    x = np.random.default_rng(1).standard_normal(n)
    x[n // 2 :] = 1.0
    return 1e-4 * x


@pytest.mark.parametrize('zeta', [1e-4, 0.015, 0.5, 0.99999, 1.0, 1.00001, 1.265, 20.0])
@pytest.mark.parametrize('frequency', [0.5, 68.0, 499.0, 5000.0])
def test_mode_is_the_exact_hold(frequency: float, zeta: float) -> None:
    w = 2 * np.pi * frequency
    a = np.array([[0.0, 1.0], [-(w**2), -2 * zeta * w]])
    ad, bd, *_ = cont2discrete(
        (a, np.array([[0.0], [w**2]]), np.eye(2), np.zeros((2, 1))), DT, method='zoh'
    )
    x, state, expected = pulse(), np.zeros(2), []
    for u in x:
        expected.append(state[0])
        state = ad @ state + bd[:, 0] * u
    y = respond('mode', x, {'natural_frequency': frequency, 'damping_ratio': zeta})
    np.testing.assert_allclose(y, expected, atol=1e-9 * np.abs(expected).max())


def test_mass_spring_and_full_share_are_the_same_mode() -> None:
    x = pulse()
    mode = respond('mode', x, {'natural_frequency': 68.0, 'damping_ratio': 0.02})
    w = 2 * np.pi * 68.0
    k = 8e5
    mass = respond(
        'mass_spring', x, {'mass': k / w**2, 'damping': 2 * 0.02 * k / w, 'stiffness': k}
    )
    share = respond(
        'resonance',
        x,
        {'resonance_frequency': 68.0, 'resonance_damping': 0.02, 'resonance_share': 1.0},
    )
    np.testing.assert_allclose(mass, mode, atol=1e-15)
    # the share of a displacement that may not have one is read at the end of the tick
    np.testing.assert_allclose(share[:-1], mode[1:], atol=1e-18)


def test_autoregression_of_000_holds_a_mode_at_68_hz() -> None:
    """The poles for these c1, c2 ring at 68 Hz with a damping ratio of 0.015."""
    x = np.zeros(4000)
    x[0] = 1.0
    y = respond('autoregressive', x, {'c1': 0.4752, 'c2': -0.7983})
    spectrum = np.abs(np.fft.rfft(y))
    assert np.argmax(spectrum[1:]) + 1 == pytest.approx(68 * 4, abs=2)
    poles = np.roots([1, -1, -0.4752, 0.7983])
    s = np.log(poles[np.argmax(poles.imag)]) / DT
    assert -s.real / abs(s) == pytest.approx(0.015, abs=2e-3)


def test_unstable_recursions_are_refused() -> None:
    with pytest.raises(ModelError, match='inside the unit circle'):
        named_block('autoregressive').pack({'c1': 0.5, 'c2': 0.5})
    with pytest.raises(ModelError, match='c3, c4'):
        named_block('exogenous3').pack({'c3': 0.5, 'c4': 0.5})


@pytest.mark.parametrize('cubic', [3e7, -5e6])
def test_nonlinear_mode_against_an_ode_solver(cubic: float) -> None:
    w, zeta = 2 * np.pi * 40.0, 0.05
    drive = 1e-4
    y = respond(
        'nonlinear_mode',
        np.full(300, drive),
        {'natural_frequency': 40.0, 'damping_ratio': zeta, 'mode_cubic': cubic},
    )
    fine = solve_ivp(
        lambda _, s: [s[1], w**2 * (drive - s[0] - cubic * s[0] ** 3) - 2 * zeta * w * s[1]],
        (0, 0.3), [0.0, 0.0], t_eval=np.arange(300) * DT, rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    assert np.abs(y - fine.y[0]).max() < 1e-5 * np.abs(y).max()


def test_a_softening_mode_that_is_pushed_over_stays_finite() -> None:
    values = {'natural_frequency': 40.0, 'damping_ratio': 0.05, 'mode_cubic': -1e8}
    y = respond('nonlinear_mode', np.full(5000, 5e-4), values)
    assert np.isfinite(y).all()
    assert y[-1] > 1e-4  # beyond 1/sqrt(1e8) m, where the spring would push it outwards


def test_friction_in_the_mode_damps_small_motion_most() -> None:
    def decay(size: Any) -> Any:
        x = np.zeros(600)
        x[0] = size
        values = {
            'natural_frequency': 40.0,
            'damping_ratio': 0.001,
            'mode_friction': 1e-6,
            'presliding': 1e-7,
        }
        y = respond('nonlinear_mode', x, values)
        return np.abs(y[-50:]).max() / np.abs(y[:50]).max()

    assert decay(1e-4) < 0.3 * decay(1e-2)


@pytest.mark.parametrize('friction', [0.0, 3e-6])
def test_tangents_of_a_nonlinear_mode_respond_with_the_bits_of_its_kernel(friction: float) -> None:
    block, dt = named_block('nonlinear_mode'), 2e-4
    values = {'natural_frequency': 400.0, 'damping_ratio': 0.02, 'mode_cubic': -1e8,
              'mode_friction': friction, 'breakaway': 1.5}  # fmt: skip
    p = block.pack({**block.defaults(), **values})
    x = np.cumsum(np.random.default_rng(3).normal(0.0, 2e-6, 800))  # turns round all the time
    moved = np.zeros((len(p) + 1, 3))
    y, rows = propagate_derivatives(
        block.kernel, x, np.ones((1, x.size)), BlockPoint(block, p, list(range(len(p)))),
        np.zeros(3), moved, dt, 0.0,
    )  # fmt: skip
    np.testing.assert_array_equal(y, respond('nonlinear_mode', x, values, dt))
    # the first row is what a voltage that is higher throughout does
    higher, lower = (respond('nonlinear_mode', x + step, values, dt) for step in (1e-10, -1e-10))
    expected = (higher - lower) / 2e-10
    np.testing.assert_allclose(rows[0], expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.component
def test_breaking_away_against_an_ode_solver() -> None:
    w, zeta, friction, presliding, more, slow = 2 * np.pi * 40.0, 0.05, 2e-6, 1e-6, 0.8, 2e-3
    dt, n = 2e-4, 1000
    drive = 1e-5 * np.sin(2 * np.pi * 11.0 * dt * np.arange(n))
    structure = {
        'natural_frequency': 40.0, 'damping_ratio': zeta, 'mode_friction': friction,
        'presliding': presliding, 'stribeck_speed': slow,
    }  # fmt: skip
    y = respond('nonlinear_mode', drive, {**structure, 'breakaway': 1.0 + more}, dt)
    dahl = respond('nonlinear_mode', drive, structure, dt)

    def rates(t: Any, s: Any) -> list[Any]:
        held = drive[min(int(t / dt + 1e-9), n - 1)]
        level = 1.0 + more * np.exp(-((s[1] / slow) ** 2))
        bristle = (s[1] - abs(s[1]) * s[2] / level) / presliding
        force = s[0] + friction * s[2]
        return [s[1], w**2 * (held - force) - 2 * zeta * w * s[1], bristle]

    fine = solve_ivp(
        rates, (0, dt * n), [0.0] * 3, t_eval=np.arange(n) * dt, rtol=1e-7, atol=1e-11,
        max_step=0.5 * dt,
    )  # fmt: skip
    assert np.abs(y - fine.y[0]).max() < 1e-4 * np.abs(y).max()
    assert np.abs(dahl - fine.y[0]).max() > 5e-2 * np.abs(y).max()


OSCILLATOR = {
    'mass': 2.0,
    'damping': 10.0,
    'stiffness': 5e4,
    'z_alpha': 5e4,
    'z_beta': 800.0,
    'z_gamma': -1100.0,
}


def oscillator_truth(force: Callable[..., Any], duration: float, dt: float) -> Any:
    def rates(t: Any, s: Any) -> list[Any]:
        x, v, z = s
        dz = 5e4 * v - 800.0 * abs(v) * z + 1100.0 * v * abs(z)
        return [v, (force(t) - 10.0 * v - 5e4 * x - z) / 2.0, dz]

    times = np.arange(round(duration / dt)) * dt
    return solve_ivp(
        rates, (0, duration), [0.0, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-15, max_step=2e-4
    ).y[0]


def test_oscillator_follows_a_band_limited_force_between_its_samples() -> None:
    """At 750 Hz with content up to 100 Hz, as in the benchmark: below 1e-3 of the output."""
    dt = 1 / 750
    tones = [(7.0, 0.3), (22.0, 1.1), (33.0, 2.0), (61.0, 0.7), (100.0, 2.9)]

    def force(t: Any) -> Any:
        fade = 0.5 - 0.5 * np.cos(np.pi * np.minimum(t / 0.1, 1.0))
        return 30.0 * fade * sum(np.sin(2 * np.pi * f * t + a) for f, a in tones)

    truth = oscillator_truth(force, 0.8, dt)
    y = respond('bouc_wen_oscillator', force(np.arange(600) * dt), OSCILLATOR, dt)
    error = np.sqrt(np.mean((y - truth) ** 2))
    assert error < 3e-4 * truth.std()
    linear = respond(
        'bouc_wen_oscillator', force(np.arange(600) * dt), {**OSCILLATOR, 'interpolation': 1.0}, dt
    )
    assert np.sqrt(np.mean((linear - truth) ** 2)) > 10 * error


def test_oscillator_holds_a_held_force_exactly() -> None:
    dt = 1 / 750
    levels = np.repeat([0.0, 60.0, -40.0, 10.0, 80.0], 40)

    def force(t: Any) -> Any:
        return levels[min(int(t / dt + 1e-9), levels.size - 1)]

    truth = oscillator_truth(force, levels.size * dt, dt)
    y = respond('bouc_wen_oscillator', levels, {**OSCILLATOR, 'interpolation': 0.0}, dt)
    assert np.abs(y - truth).max() < 1e-4 * np.abs(truth).max()


def test_oscillator_refines_its_steps_for_stiff_springs() -> None:
    """A resonance at five times the rate is still integrated, not blown up."""
    values = {'mass': 1.0, 'damping': 3e3, 'stiffness': 1e9, 'z_alpha': 0.0}
    y = respond('bouc_wen_oscillator', np.full(2000, 1e3), values)
    assert y[-1] == pytest.approx(1e-6, rel=1e-6)


def test_a_delay_of_a_held_voltage_has_come_at_the_end_of_the_tick() -> None:
    x = pulse()
    np.testing.assert_array_equal(respond('transport_delay', x, {'delay': 3e-3})[3:], x[:-3])
    np.testing.assert_array_equal(respond('transport_delay', x, {'delay': 2.5e-3})[2:], x[:-2])
    ramp = np.arange(500.0)
    late = respond('transport_delay', ramp, {'delay': 0.1})
    np.testing.assert_allclose(late[101:], ramp[101:] - 100.0)


@pytest.mark.parametrize('name', ['amplifier_lag', 'sensor_lag'])
def test_a_lag_goes_to_a_held_input_exponentially(name: str) -> None:
    parameter = {'amplifier_lag': 'lag_time', 'sensor_lag': 'sensor_lag_time'}[name]
    y = respond(name, np.ones(50), {parameter: 4e-3})
    np.testing.assert_allclose(y, 1.0 - np.exp(-DT / 4e-3 * np.arange(1, 51)), rtol=1e-12)
    np.testing.assert_array_equal(respond(name, pulse(), {parameter: 0.0}), pulse())


def test_slew_limit_makes_triangles() -> None:
    x = np.concatenate([np.full(50, 1.0), np.full(50, -1.0)])
    y = respond('slew_limit', x, {'slew_rate': 100.0})
    np.testing.assert_allclose(np.diff(y[:10]), 0.1)
    np.testing.assert_allclose(np.diff(y[50:70]), -0.1)
    assert y[-1] == -1.0


def test_saturation_cuts_either_side() -> None:
    y = respond('saturation', [-2.0, -0.5, 2.0], {'saturation_high': 1.5, 'saturation_low': 1.0})
    np.testing.assert_array_equal(y, [-1.0, -0.5, 1.5])
