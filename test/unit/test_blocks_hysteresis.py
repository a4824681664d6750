"""Hysteresis blocks against fine integration and against what defines them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block

DT = 1e-3


def respond(name: Any, x: Any, values: Any, dt: Any = DT, frequency: float = 0.0) -> FloatArray:
    block = named_block(name)
    return block.respond(
        np.asarray(x, float), block.pack(values), dt, state=block.initial_state(dt),
        frequency=frequency,
    )  # fmt: skip


def fine_bouc_wen(
    x: FloatArray, values: dict[str, float], parts: int, exponent: float = 1.0
) -> np.ndarray:
    """Bouc-Wen by the midpoint rule in `parts` pieces per sample: an independent answer."""
    a, a0, beta, gamma = (values[k] for k in ('A', 'A0', 'beta', 'gamma'))
    height = (abs(a) + abs(a0)) / (beta + gamma)
    h, last, y = 0.0, 0.0, []

    def rate(h: Any, side: Any) -> Any:
        bend = max(abs(h / height), 1e-9) ** (exponent - 1.0) if exponent != 1.0 else 1.0
        return a * side + a0 - bend * (gamma * abs(h) * side + beta * h)

    for u in x:
        step = abs(u - last) / parts
        side = np.sign(u - last)
        for _ in range(parts):
            h += step * rate(h + 0.5 * step * rate(h, side), side)
        last = u
        y.append(values['A1'] * u - h)
    return np.array(y)


VALUES = {'A1': 1.5e-4, 'A': 4e-5, 'A0': 2e-6, 'beta': 3.0, 'gamma': -1.2}


def wave(samples: int = 150) -> FloatArray:
    t = np.arange(samples) / samples
    return np.sin(2 * np.pi * 3 * t) * (1 - 0.5 * t) + 0.1 * np.sin(2 * np.pi * 11 * t)


def test_exact_step_is_the_limit_of_fine_integration() -> None:
    coarse = respond('bouc_wen_exact', wave(), VALUES)
    np.testing.assert_allclose(coarse, fine_bouc_wen(wave(), VALUES, 2000), atol=2e-11)


def test_euler_step_converges_to_the_exact_one_with_first_order() -> None:
    def error(samples: int) -> Any:
        x = np.sin(2 * np.pi * np.arange(samples + 1) / samples)
        return abs(respond('bouc_wen', x, VALUES) - respond('bouc_wen_exact', x, VALUES)).max()

    assert error(2000) / error(4000) == pytest.approx(2.0, rel=0.05)
    # 50 Hz at 1 kHz: the papers' discrete model is another model at every frequency
    assert error(20) > 30 * error(1000)


def test_euler_step_is_the_printed_recursion() -> None:
    x = wave(60)
    h, last, expected = 0.0, 0.0, []
    for u in x:
        du = u - last
        last = u
        h = (
            h
            + VALUES['A'] * du
            + VALUES['A0'] * abs(du)
            - VALUES['gamma'] * abs(h) * du
            - VALUES['beta'] * abs(du) * h
        )
        expected.append(VALUES['A1'] * u - h)
    np.testing.assert_allclose(respond('bouc_wen', x, VALUES), expected, rtol=1e-13)


@pytest.mark.parametrize(
    ('exponent', 'share'), [(0.7, 5e-4), (1.5, 1e-4), (2.0, 1e-4), (4.0, 1e-4)]
)
def test_exponent_is_integrated_to_a_small_share_of_the_loop(
    exponent: float, share: float
) -> None:
    values = {**VALUES, 'gamma': 1.2}
    y = respond('bouc_wen_power', wave(), {**values, 'exponent': exponent})
    fine = fine_bouc_wen(wave(), values, 1000, exponent)
    h = 1.5e-4 * wave() - fine
    assert np.abs(y - fine).max() < share * np.ptp(h)


def test_exponent_keeps_the_height_of_the_loop() -> None:
    x = np.concatenate([np.linspace(0, 20, 2000), np.linspace(20, -20, 4000)])
    for exponent in (1.0, 2.0, 3.0):
        values = {'A1': 0.0, 'A': 4e-5, 'beta': 1.0, 'gamma': 1.0, 'exponent': exponent}
        h = -respond('bouc_wen_power', x, values)
        assert h[1999] == pytest.approx(2e-5, rel=1e-6)


def test_zhou_moves_257_micrometres_at_60_volts() -> None:
    """Zhou 2021 Table 2 with its units mended."""
    d, alpha, beta, gamma = 5.5e-6, 0.61, 0.039, 0.0065
    saturation = d * alpha / (beta + gamma)
    assert saturation == pytest.approx(73.7e-6, rel=0.01)
    t = np.arange(4000) / 1000
    x = 60 * np.sin(2 * np.pi * t)
    y = respond('bouc_wen_exact', x, {'A1': d, 'A': alpha * d, 'beta': beta, 'gamma': gamma})
    assert np.ptp(y[2000:]) / 2 == pytest.approx(257e-6, rel=0.02)


def test_rate_widens_the_loop_only_above_its_corner() -> None:
    values = {**VALUES, 'rate_corner': 10.0, 'rate_exponent': 0.5, 'rate_memory': 0.0}

    def loop(frequency: Any, block: Any, more: Any) -> FloatArray:
        t = np.arange(int(4 / frequency / DT)) * DT
        y = respond(block, np.sin(2 * np.pi * frequency * t), {**VALUES, **more})
        return y[-int(1 / frequency / DT) :]

    rated = {k: values[k] for k in ('rate_corner', 'rate_exponent', 'rate_memory')}
    slow = loop(0.1, 'bouc_wen_rate', rated) - loop(0.1, 'bouc_wen_exact', {})
    fast = loop(50.0, 'bouc_wen_rate', rated) - loop(50.0, 'bouc_wen_exact', {})
    assert np.abs(slow).max() < 0.1 * np.abs(fast).max()


@pytest.mark.parametrize('name', ['prandtl_ishlinskii', 'preisach'])
def test_larger_reversals_wipe_out_smaller_ones(name: str) -> None:
    """Nonlocal memory: after an inner loop the outer branch continues without change."""
    outer = [0.8, -0.6, 0.5]
    inner = [0.8, -0.6, 0.2, -0.1, 0.1, -0.3, 0.5]

    def at_end(corners: Any) -> Any:
        path = [np.linspace(a, b, 200) for a, b in zip([0.0, *corners], corners, strict=False)]
        return respond(name, np.concatenate(path), {})[-1]

    assert at_end(inner) == pytest.approx(at_end(outer), rel=1e-12)
    assert at_end([0.8, 0.5]) != pytest.approx(at_end(outer), rel=1e-3)


@pytest.mark.parametrize('name', ['prandtl_ishlinskii', 'preisach'])
def test_inner_loops_between_the_same_voltages_are_congruent(name: str) -> None:
    def loop(before: Any) -> Any:
        corners = [*before, -0.2, 0.3, -0.2, 0.3]
        path = [np.linspace(a, b, 101)[1:] for a, b in zip([0.0, *corners], corners, strict=False)]
        y = respond(name, np.concatenate(path), {})[-200:]
        return y - y[-1]

    np.testing.assert_allclose(loop([0.9, -0.8]), loop([-0.9, 0.4]), atol=1e-15)


def test_a_play_bank_has_nonlocal_memory_and_bouc_wen_has_not() -> None:
    outer, inner = [0.8, -0.6, 0.5], [0.8, -0.6, 0.2, -0.3, 0.5]

    def at_end(corners: Any) -> Any:
        path = [np.linspace(a, b, 200) for a, b in zip([0.0, *corners], corners, strict=False)]
        return respond('bouc_wen_exact', np.concatenate(path), VALUES)[-1]

    assert abs(at_end(inner) - at_end(outer)) > 1e-7


def test_preisach_equals_its_relays() -> None:
    """Against brute force: every relay of a fine grid, uniform within the cells."""
    rng = np.random.default_rng(3)
    weights = rng.uniform(1e-6, 4e-6, 36)
    names = [f'mu_{i}_{j}' for i in range(8) for j in range(i + 1)]
    corners = [0.75, -0.5, 0.5, -0.25, 0.25, -0.75, 0.5]
    y = [
        respond(
            'preisach',
            np.concatenate(
                [np.linspace(a, b, 9) for a, b in zip([0.0, *corners[:n]], corners[:n],
                                                      strict=False)]
            ),
            dict(zip(names, weights, strict=True)),
        )[-1]
        for n in range(1, len(corners) + 1)
    ]  # fmt: skip
    # all corners lie on cell edges, where a cell is a single relay
    on = np.zeros(36)
    cell = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(8) for j in range(i + 1))}
    expected, last = [], 0.0
    for corner in corners:
        level = round(corner * 4) + 4
        for (i, j), k in cell.items():
            if corner > last and i < level:
                on[k] = 1.0
            if corner < last and j >= level:
                on[k] = 0.0
        last = corner
        expected.append(float(on @ weights))
    # the demagnetised state sets a constant that the first branch does not tell
    np.testing.assert_allclose(np.diff(y[1:]), np.diff(expected[1:]), atol=1e-18)


def test_preisach_drops_the_smallest_loop_when_memory_is_full() -> None:
    corners = [(-1) ** k * (0.95 - 0.006 * k) for k in range(150)]
    path = [np.linspace(a, b, 5) for a, b in zip([0.0, *corners], corners, strict=False)]
    y = respond('preisach', np.concatenate(path), {})
    assert np.isfinite(y).all()
    assert np.abs(y).max() <= 0.5 * 2.6e-4


def test_modified_law_of_004_with_the_papers_numbers() -> None:
    """Slope within 0.93 .. 1.86 for gamma = -2.08 read with a plus sign."""
    t = np.linspace(0, 4, 40001)
    x = 5 - 5 * np.cos(2 * np.pi * t)
    values = {'A1': 1.86e-3, 'A': 0.75 * 1.14e-3, 'beta': 2.49, 'gamma': 2.08}
    y = respond('bouc_wen_modified', x, values)
    moving = np.abs(np.diff(x)) > 1e-6
    slope = np.diff(y)[moving] / np.diff(x)[moving]
    later = slope[20000:]
    assert later.min() > 0.9e-3
    assert later.max() < 1.9e-3


def test_bend_about_a_bias_makes_the_loop_unsymmetrical() -> None:
    t = np.arange(8000) * DT
    x = np.sin(2 * np.pi * t)
    base = {'A1': 1e-4, 'A': 2e-5, 'beta': 2.0, 'gamma': 0.5}

    def second_harmonic(bias: Any) -> Any:
        y = respond('bouc_wen_modified', x, {**base, 'epsilon': 5e-6, 'bias': bias})
        return abs(np.fft.rfft(y[-1000:])[2])

    assert second_harmonic(0.0) < 1e-9 * second_harmonic(0.5)


def test_selector_with_equal_knots_is_the_inverse_itself() -> None:
    x = wave()
    plain = respond('inverse_bouc_wen', x, {})
    np.testing.assert_allclose(respond('inverse_selector', x, {}), plain, atol=1e-15)


def test_selector_follows_the_slope() -> None:
    """At the slope of a knot it answers with the parameters of that knot."""
    span = 0.05
    knots = {f'inverse_gain_at{i}': 7e3 + 100.0 * i for i in range(1, 11)}
    knots |= {f'inverse_A_at{i}': 0.0 for i in range(1, 11)}
    slope = 0.4 * span
    voltage = np.arange(1, 201) * DT * slope * 7400.0
    y = respond('inverse_selector', voltage, knots)
    assert np.diff(y)[-1] / DT == pytest.approx(slope, rel=1e-6)


def test_a_selector_whose_table_is_steep_still_answers_smoothly() -> None:
    """By the row of the move before, the slope would jump between two rows from tick to tick."""
    span = 0.05
    steep = {f'inverse_gain_at{i}': 7e3 * (1.0 if i < 5 else 3.0) for i in range(1, 11)}
    steep |= {f'inverse_A_at{i}': 0.0 for i in range(1, 11)}
    slope = 0.47 * span  # between the fourth and the fifth row
    gain = 7e3 * (1.0 + 2.0 * 0.7)
    y = respond('inverse_selector', np.arange(1, 201) * DT * slope * gain, steep)
    np.testing.assert_allclose(np.diff(y) / DT, slope, rtol=1e-9)


def test_side_by_side_bank_adds_play() -> None:
    x = wave()
    more = {f'memory{j}': 0.0 for j in range(1, 10)} | {'memory4': 1e-5}
    y = respond('bouc_wen_exact|nonlocal_memory', x, {**VALUES, **more})
    extra = (y - respond('bouc_wen_exact', x, VALUES)) / 1e-5
    memory, expected = 0.0, []
    for u in x:
        memory = max(u - 0.4, min(u + 0.4, memory))
        expected.append(memory)
    np.testing.assert_allclose(extra, expected, atol=1e-9)
