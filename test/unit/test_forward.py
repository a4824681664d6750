"""Derivatives that are generated from the source of kernels."""

from __future__ import annotations

from collections.abc import Callable
from math import asinh, atan, copysign, cos, cosh, exp, expm1, log, log1p, sin, sinh, sqrt, tanh
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.blocks.base import Block, Slot
from piezo_hysteresis.jit import jit, scratch
from piezo_hysteresis.kernels.forward import NotDifferentiable, directions_of, jacobian
from piezo_hysteresis.models.simulation.substep_sensitivities import (
    BlockPoint,
    propagate_derivatives,
)

DT = 1e-3


@jit
def rules(a: float, b: float) -> float:
    c = exp(a) + expm1(b) * log(a) - log1p(b) / sqrt(a) + sin(a * b) * cos(a - b)
    return float(c + tanh(a) * sinh(b) / cosh(a) + asinh(a) * atan(b) + a**b + b**2 - (-a) / b)


@jit
def kinks(a: float, b: float) -> float:
    c = min(a, b) * max(2.0 * a, b) + abs(a - b) * copysign(a, -b)
    c += float(a) if a > b else b * b
    return c


@jit
def in_two(a: float, b: float) -> tuple[float, float]:
    half = 0.5 * a
    return half * b, b / half


@jit
def early(a: float, b: float) -> float:
    if a > 2.0:
        return a * b
    total = 0.0
    for k in range(5):
        if k == 3:
            break
        one, other = in_two(a + k, b)
        one, other = other, one
        total += one * other + k * a
    while total > 10.0:
        total *= 0.5
    return total


@jit
def nested(a: float, b: float) -> float:
    pair = in_two(a, b)
    both = (pair, (a * b, 1.0))
    (c, d), rest = both
    return c * rest[0] + d * both[1][1] + pair[0]


@pytest.mark.parametrize('function', [rules, kinks, early, nested], ids=lambda f: str(f.__name__))
@pytest.mark.parametrize('place', [(0.7, 1.3), (1.9, 0.4), (2.6, 3.1)])
def test_a_jacobian_equals_central_differences(
    function: Callable[..., float], place: tuple[float, float]
) -> None:
    a, b = place
    value, by_a, by_b = jacobian(function)(a, b)
    assert value == function(a, b)
    h = 1e-6
    assert by_a == pytest.approx((function(a + h, b) - function(a - h, b)) / 2 / h, rel=1e-7)
    assert by_b == pytest.approx((function(a, b + h) - function(a, b - h)) / 2 / h, rel=1e-7)


@jit
def reversed_sums(x: FloatArray, y: FloatArray, scale: float) -> None:
    table = scratch((x.size, 2))
    for k in range(x.size):
        table[k, 0], table[k, 1] = x[k] * x[k], scale * x[x.size - 1 - k]
    tail = x[1:]
    for k in range(tail.size):
        y[k] = table[k, 0] * table[k, 1] + tail[k]
    y[x.size - 1] = 0.0


def test_arrays_carry_their_tangents() -> None:
    def function(x: Any) -> Any:
        y = np.empty_like(x)
        reversed_sums(x, y, 3.0)
        return y

    rng = np.random.default_rng(1)
    x, x_d = rng.normal(size=7), rng.normal(size=(2, 7))
    y, y_d = np.empty(7), np.empty((2, 7))
    along = directions_of(reversed_sums, 2)
    along(x, y, 3.0, x_d, y_d)
    np.testing.assert_array_equal(y, function(x))
    for row, answer in zip(x_d, y_d, strict=True):
        expected = (function(x + 1e-6 * row) - function(x - 1e-6 * row)) / 2e-6
        np.testing.assert_allclose(answer, expected, rtol=1e-7, atol=1e-9)


def unknown(x: float) -> float:
    return float(sum([x]))


def test_what_has_no_rule_is_refused() -> None:
    with pytest.raises(NotDifferentiable, match='x'):
        jacobian(unknown)


def drawn(block: Block, rng: np.random.Generator) -> FloatArray:
    """Return parameters near those that a block begins with, none of them at a bound."""
    p = []
    for q in block.parameters:
        usual = q.default if abs(q.default) > 1e-3 * q.scale else 0.3 * q.scale
        usual = q.scale if abs(usual) > 1e3 * q.scale else usual  # no limit at all
        p.append(float(np.clip(usual * rng.uniform(0.8, 1.25), q.low, q.high)))
    return np.array(p)


def drive(block: Block, rng: np.random.Generator) -> FloatArray:
    """Return a voltage [V], or a displacement [m] for what comes behind the hysteresis."""
    t = DT * np.arange(240)
    u = 0.8 * np.sin(2 * np.pi * 5 * t) + 0.3 * np.sin(2 * np.pi * 17 * t)
    volts = block.slot in (Slot.INPUT, Slot.HYSTERESIS)
    return np.asarray((1.0 if volts else 3e-5) * (u + 1e-3 * rng.normal(size=t.size)))


LAWS = [(b.name, kind) for b in BLOCKS.values() for kind in ('kernel', 'path_kernel')
        if getattr(b, kind) is not None]  # fmt: skip


@pytest.mark.component
@pytest.mark.parametrize(('name', 'kind'), LAWS)
def test_derivatives_of_every_block_equal_central_differences(name: str, kind: str) -> None:
    block, rng = BLOCKS[name], np.random.default_rng(len(name))
    p, x, law = drawn(block, rng), drive(block, rng), getattr(block, kind)
    clock: tuple[Any, ...] = (DT, 5.0)
    if kind == 'path_kernel':
        x, clock = np.repeat(x, 6), (DT, 5.0, 6)
    row = np.repeat(rng.normal(size=240), x.size // 240) * np.max(np.abs(x))

    def respond(u: FloatArray, values: FloatArray) -> FloatArray:
        y = np.empty_like(u)
        law(u, y, block.initial_state(DT), values, *clock)
        return y

    state, columns = block.initial_state(DT), list(range(p.size))
    moved = np.zeros((1 + p.size, state.size))
    y, rows = propagate_derivatives(
        law, x, row[None], BlockPoint(block, p, columns), state, moved, *clock
    )
    np.testing.assert_array_equal(y, respond(x, p))
    for place in range(1 + p.size):
        missed = []
        for share in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
            du = share * row if place == 0 else 0.0 * row
            dp = np.zeros(p.size)
            if place:
                dp[place - 1] = share * max(abs(p[place - 1]), 1e-300)
            size = share if place == 0 else dp[place - 1]
            expected = (respond(x + du, p + dp) - respond(x - du, p - dp)) / (2.0 * size)
            largest = float(np.max(np.abs(expected))) or 1.0
            # a corner within a step is met by few samples
            missed.append(float(np.quantile(np.abs(rows[place] - expected), 0.9)) / largest)
        assert min(missed) < 2e-6, (place, missed)
