"""The compiled physics against independent solutions: SciPy's solvers and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from piezo_sim import Plant
from piezo_sim.parts.amplifier import FAR, toward
from piezo_sim.parts.sensor import normal, uniform

RATE = 1000.0


def _path(seed: int, count: int = 400, size: float = 0.9) -> np.ndarray:
    """Commands that wander, with steps and reversals."""
    rng = np.random.default_rng(seed)
    return np.clip(np.cumsum(rng.normal(0.0, 0.2, count)), -size, size)


def _quiet(**switches: Any) -> dict[Any, Any]:
    return {f'effects.{name}': on for name, on in switches.items()}


@pytest.mark.parametrize('exponent', [1.0, 1.5, 3.0])
def test_bouc_wen_is_its_differential_equation(exponent: float) -> None:
    alpha, beta, gamma, extra = 0.5, 1.3, 0.4, 0.08
    plant = Plant({
        **_quiet(bouc_wen=True, asymmetry=True, hysteresis_exponent=True),
        'bouc_wen.alpha': alpha, 'bouc_wen.beta': beta, 'bouc_wen.gamma': gamma,
        'bouc_wen.asymmetry': extra, 'bouc_wen.exponent': exponent,
    })  # fmt: skip
    path = _path(1, 120)
    saturation = (alpha + extra) / (beta + gamma)
    eta, last, expected = 0.0, 0.0, []
    for v in path:
        sign = math.copysign(1.0, v - last)

        def rate(_: Any, e: Any, sign: Any = sign) -> Any:
            size = abs(e[0]) * (abs(e[0]) / saturation) ** (exponent - 1.0)
            return alpha + sign * extra - (beta * math.copysign(1, e[0] * sign) + gamma) * size

        if v != last:
            answer = solve_ivp(rate, (last, v), [eta], rtol=1e-10, atol=1e-13, max_step=0.01)
            eta = answer.y[0, -1]
        last = v
        expected.append(1e-4 * (v - eta))
    readings = plant.run(np.append(path, 0.0))[1:]
    np.testing.assert_allclose(readings, expected, atol=1e-10)  # half a millionth of the stroke


def _monotone(start: Any, end: Any, pieces: int = 1) -> np.ndarray:
    return np.linspace(start, end, pieces + 1)[1:]


@pytest.mark.parametrize('law', ['play', 'preisach'])
def test_nonlocal_memory_closes_and_erases_minor_loops(law: str) -> None:
    """Return-point memory and wiping out, whatever happened inside the minor loop."""
    straight, detour = (Plant(_quiet(**{law: True})) for _ in range(2))
    head = np.concatenate([_monotone(0, 0.9), _monotone(0.9, -0.8), _monotone(-0.8, 0.4)])
    inner = np.array([0.4, -0.3, 0.1, -0.2, 0.0, -0.3, 0.2, 0.1, 0.4])
    tail = np.array([0.5, 0.7, 0.95, 0.2, -0.9, 0.3])
    expected = straight.run(np.concatenate([head, tail, [0.0]]))[-tail.size :]
    measured = detour.run(np.concatenate([head, inner, tail, [0.0]]))[-tail.size :]
    np.testing.assert_allclose(measured, expected, atol=1e-18)
    # The pieces in which a branch is run through do not matter.
    fine = Plant(_quiet(**{law: True}))
    fine.run(np.concatenate([_monotone(0, 0.9, 7), _monotone(0.9, -0.8, 13)]))
    coarse = Plant(_quiet(**{law: True}))
    coarse.run([0.9, -0.8])
    assert fine.displacement == pytest.approx(coarse.displacement, abs=1e-18)


def test_bouc_wen_has_no_return_point_memory() -> None:
    ends = []
    for inner in ([], [0.0, 0.4] * 5):
        plant = Plant(_quiet(bouc_wen=True))
        plant.run([0.9, -0.8, 0.4, *inner])
        ends.append(plant.displacement)
    assert abs(ends[1] - ends[0]) > 1e-6


def test_play_is_the_sum_of_its_operators() -> None:
    plant = Plant(_quiet(play=True))
    values = plant.parameters
    path, q, expected = _path(2), np.zeros(12), []
    radius = np.array([values[f'play.radius_{j:02}'] for j in range(1, 13)])
    weight = np.array([values[f'play.weight_{j:02}'] for j in range(1, 13)])
    for v in path:
        q = np.maximum(v - radius, np.minimum(v + radius, q))
        expected.append(1e-4 * (values['play.linear_weight'] * v + weight @ q))
    np.testing.assert_allclose(plant.run(np.append(path, 0.0))[1:], expected, atol=1e-17)


def test_preisach_is_a_grid_of_relays() -> None:
    """The closed form against relays on a fine grid weighted by its density."""
    plant = Plant(
        {
            **_quiet(preisach=True, asymmetry=True),
            'preisach.asymmetry': 0.15,
            'amplifier.range_low': -1.0,
            'amplifier.range_high': 1.0,
        }
    )
    q = plant.parameters
    n, reach = 400, 1.0
    edge = np.linspace(-reach, reach, n + 1)
    centre = 0.5 * (edge[1:] + edge[:-1])
    up, down = np.meshgrid(centre, centre, indexing='ij')  # switches up at `up`, down at `down`
    x, m = 0.5 * (up - down), 0.5 * (up + down)
    c = 1 + q['preisach.asymmetry'] * m - q['preisach.curvature'] * m**2
    g = x + q['preisach.scale'] * np.expm1(-x / q['preisach.scale'])
    bend = np.exp(-x / q['preisach.scale']) / q['preisach.scale']
    density = 0.5 * q['preisach.weight'] * (bend * c + 2 * q['preisach.curvature'] * g)
    cell = (2 * reach / n) ** 2 * np.where(up > down, 1.0, np.where(up == down, 0.5, 0.0))
    assert density[up >= down].min() > 0
    relay = np.where(up + down > 0, -0.5, 0.5)  # demagnetised
    expected, path = [], [0.9, -0.7, 0.3, -0.2, 0.5, -0.95, 0.1]
    for v in path:
        relay = np.where(up <= v, 0.5, np.where(down >= v, -0.5, relay))
        expected.append(1e-4 * (q['preisach.linear_weight'] * v + np.sum(density * cell * relay)))
    base = expected[0] - plant.run([path[0], path[0]])[-1]  # constant of the asymmetric density
    measured = plant.run([*path[1:], 0.0])[1:]
    np.testing.assert_allclose(measured, np.array(expected[1:]) - base, atol=2e-7)
    assert abs(base) < 5e-7


@pytest.mark.parametrize('tau', [0.0, 0.7e-3])
@pytest.mark.parametrize('slew', [FAR, 400.0])
def test_the_amplifier_is_the_limited_first_order_lag(tau: float, slew: Any) -> None:
    if tau == 0.0:
        expected = 1.0 if slew == FAR else 0.4
        assert toward(0.0, 1.0, 1e-3, tau, slew) == pytest.approx(expected)
        return
    answer = solve_ivp(
        lambda _, v: np.clip((1.0 - v) / tau, -slew, slew), (0, 3e-3), [-0.5],
        rtol=1e-10, atol=1e-12, max_step=1e-6 if slew < FAR else 1e-4,
    )  # fmt: skip
    assert toward(-0.5, 1.0, 3e-3, tau, slew) == pytest.approx(answer.y[0, -1], abs=1e-7)
    halfway = toward(-0.5, 1.0, 1.1e-3, tau, slew)
    assert toward(halfway, 1.0, 1.9e-3, tau, slew) == pytest.approx(answer.y[0, -1], abs=1e-7)


def _structure(extra: dict[Any, Any], command: np.ndarray, rate: Any = RATE) -> Any:
    plant = Plant(
        {**_quiet(resonance=True), 'structure.natural_frequency': 90.0,
         'structure.damping_ratio': 0.04, **extra},
        rate=rate,
    )  # fmt: skip
    return plant.run(np.append(command, 0.0))[1:], plant.parameters


def _solve(
    force: Callable[..., Any], command: np.ndarray, states: int, rate: Any = RATE
) -> np.ndarray:
    """Integrate x'' = force(x, v, extra, w, t) sample by sample with SciPy."""
    state, out = np.zeros(2 + states), []
    for k, u in enumerate(command):
        answer = solve_ivp(
            lambda t, s, w=1e-4 * u: force(s, w, t), (k / rate, (k + 1) / rate), state,
            rtol=1e-9, atol=1e-14, max_step=2e-5,
        )  # fmt: skip
        state = answer.y[:, -1]
        out.append(state[0])
    return np.array(out)


OMEGA, ZETA = 2 * math.pi * 90.0, 0.04


def _linear(s: Any, w: Any) -> Any:
    return OMEGA**2 * (w - s[0]) - 2 * ZETA * OMEGA * s[1]


CASES = {
    'stiffness': (
        {'structure.cubic': 3e7},
        0,
        lambda s, w, t: [s[1], _linear(s, w) - OMEGA**2 * 3e7 * s[0] ** 3],
    ),
    'amplitude_damping': (
        {'structure.quadratic_damping': 300.0},
        0,
        lambda s, w, t: [s[1], _linear(s, w) - 300.0 * abs(s[1]) * s[1]],
    ),
    'contact': (
        {'contact.stiffness': 0.5, 'contact.position': 2e-5, 'contact.reach': 1e-5},
        0,
        lambda s, w, t: [s[1], _linear(s, w)
                         - OMEGA**2 * 0.5e-5 * max((s[0] - 2e-5) / 1e-5, 0.0) ** 2],
    ),
    'parametric_excitation': (
        {'structure.pump_depth': 0.3, 'structure.pump_frequency': 37.0,
         'structure.pump_reach': 2e-4},
        0,
        lambda s, w, t: [s[1], _linear(s, w) - OMEGA**2 * 0.3
                         * math.cos(2 * math.pi * 37.0 * t) * s[0] / (1 + (s[0] / 2e-4) ** 2)],
    ),
    'restoring_hysteresis': (
        {'restoring.share': 0.4, 'restoring.beta': 9e3, 'restoring.gamma': -3e3},
        1,
        lambda s, w, t: [s[1], _linear(s, w) - OMEGA**2 * 0.4 * (s[2] - s[0]),
                         s[1] - 9e3 * abs(s[1]) * s[2] + 3e3 * s[1] * abs(s[2])],
    ),
    'friction': (
        {'friction.coulomb': 2e-6, 'friction.presliding': 5e-6, 'friction.stiction': 1.5,
         'friction.stribeck_speed': 3e-3},
        1,
        lambda s, w, t: [s[1], _linear(s, w) - OMEGA**2 * 2e-6 * s[2],
                         (s[1] - abs(s[1]) * s[2]
                          / (1 + 0.5 * math.exp(-((s[1] / 3e-3) ** 2)))) / 5e-6],
    ),
}  # fmt: skip


@pytest.mark.parametrize('effect', sorted(CASES))
def test_nonlinear_structures_follow_their_equations_of_motion(effect: Any) -> None:
    extra, states, force = CASES[effect]
    command = _path(3, 60)
    measured, _ = _structure({**extra, f'effects.{effect}': True}, command)
    expected = _solve(force, command, states)
    assert np.abs(measured - expected).max() < 1e-6 * np.ptp(expected)


@pytest.mark.parametrize('zeta', [0.001, 0.5, 1.0, 1.0 + 1e-9, 4.0])
def test_linear_modes_are_exact_whatever_their_damping(zeta: float) -> None:
    from scipy.linalg import expm

    command = _path(4, 100)
    measured, _ = _structure({'structure.damping_ratio': zeta}, command)
    system = np.array([[0, 1, 0], [-(OMEGA**2), -2 * zeta * OMEGA, OMEGA**2], [0, 0, 0]])
    step, state, expected = expm(system / RATE), np.zeros(3), []
    for u in command:
        state = step @ [*state[:2], 1e-4 * u]
        expected.append(state[0])
    np.testing.assert_allclose(measured, expected, atol=1e-15 if zeta < 2 else 1e-13)


def test_delay_and_lag_act_in_continuous_time() -> None:
    """A lagged mode behind a delay of a fraction of a sample, against a fine simulation."""
    delay, tau = 2.37e-3, 0.8e-3
    command = _path(5, 80)
    measured, _ = _structure(
        {**_quiet(amplifier_lag=True, transport_delay=True), 'amplifier.delay': delay,
         'amplifier.lag_time_constant': tau}, command,
    )  # fmt: skip

    def force(s: Any, w: Any, t: Any) -> list[Any]:
        late = math.floor((t - delay) * RATE + 1e-9)
        target = command[late] if late >= 0 else 0.0
        return [s[1], _linear(s, 1e-4 * s[2]), (target - s[2]) / tau]

    state, expected = np.zeros(3), []
    for k in range(command.size):
        for first, last in ((k, k + 0.37), (k + 0.37, k + 1.0)):
            middle = 0.5 * (first + last) / RATE
            answer = solve_ivp(
                lambda t, s, m=middle: force(s, 0.0, m), (first / RATE, last / RATE), state,
                rtol=1e-10, atol=1e-15,
            )  # fmt: skip
            state = answer.y[:, -1]
        expected.append(state[0])
    assert np.abs(measured - expected).max() < 1e-5 * np.ptp(expected)  # delay to 1/16384 sample


def test_random_numbers_are_even_normal_and_independent_of_stream_and_count() -> None:
    seed = np.uint64(7)
    with np.errstate(over='ignore'):  # pieces of a kernel: plain Python warns where words wrap
        draws = np.array([[normal(seed, s, np.uint64(k)) for k in range(20_000)] for s in (1, 2)])
        even = np.array([uniform(seed, 1, np.uint64(k)) for k in range(20_000)])
    assert np.abs(draws.mean(axis=1)).max() < 4 / math.sqrt(20_000)
    np.testing.assert_allclose(draws.std(axis=1), 1.0, atol=0.02)
    assert abs((draws**4).mean() - 3.0) < 0.2
    assert abs(np.corrcoef(draws)[0, 1]) < 0.03
    assert abs(np.corrcoef(draws[0, 1:], draws[0, :-1])[0, 1]) < 0.03
    assert np.abs(np.histogram(even, 10, (0, 1))[0] - 2000).max() < 200
