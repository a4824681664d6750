"""Inverses of the hysteresis blocks, sample by sample: from w = A1 u - h to u.

Every kernel is ``kernel(w, u, memory, p, minimum, low, high)``. The memory begins with the
counters (clamped slopes, samples outside the stroke), the last voltage and h. A slope below
`minimum` is clamped and counted, and its sign is kept. The memory is updated with the voltage as
limited to low..high.
"""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import exact_step
from piezo_hysteresis.blocks._plays import bank
from piezo_hysteresis.jit import inline_jit

CLAMPED, STROKE, U, H = range(4)

_ITERATIONS = 60


@inline_jit
def within_stroke(new: float, low: float, high: float, memory: FloatArray) -> float:
    """Return the voltage limited to low..high [V], and count limited samples."""
    if new > high or new < low:
        memory[STROKE] += 1.0
        return min(max(new, low), high)
    return new


@inline_jit
def slope(h: float, side: float, p: FloatArray) -> float:
    """Return dw/du [m/V] of the Bouc-Wen model at h for a voltage that moves to `side`."""
    value: float = p[0] - p[1] - side * p[2] + p[4] * abs(h) + side * p[3] * h
    return value


@inline_jit
def euler_step(h: float, du: float, p: FloatArray) -> float:
    """Return h after the papers' forward Euler step."""
    value: float = h + p[1] * du + p[2] * abs(du) - p[4] * abs(h) * du - p[3] * abs(du) * h
    return value


@inline_jit
def invert_euler(
    w: FloatArray,
    u: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    minimum: float,
    low: float,
    high: float,
) -> None:
    """Solve the Euler step for the voltage, on the branch with the sign of the difference."""
    last, h = memory[U], memory[H]
    for k in range(w.size):
        missing = w[k] - p[0] * last + h
        side = 1.0 if missing > 0.0 else -1.0
        gradient = slope(h, side, p)
        if gradient < minimum:
            gradient = minimum
            if missing != 0.0:
                memory[CLAMPED] += 1.0
        new = last + missing / gradient
        new = within_stroke(new, low, high, memory)
        h = euler_step(h, new - last, p)
        last = new
        u[k] = new
    memory[U], memory[H] = last, h


@inline_jit
def invert_delayed(
    w: FloatArray,
    u: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    minimum: float,
    low: float,
    high: float,
) -> None:
    """Rakotondrabe's ``u[k] = (w[k] + h[k-1]) / A1``, Fujii 2018 (14), Zhou 2021 (8)."""
    last, h = memory[U], memory[H]
    for k in range(w.size):
        new = (w[k] + h) / p[0]
        new = within_stroke(new, low, high, memory)
        h = euler_step(h, new - last, p)
        last = new
        u[k] = new
    memory[U], memory[H] = last, h


@inline_jit
def solve_exact(missing: float, h: float, p: FloatArray, minimum: float) -> float:
    """Return the voltage step that moves the exact model by `missing` [m].

    Newton steps from the Euler guess, limited to a bracket. If the slope is too small to reach the
    target within ``missing / minimum``, that step is returned.
    """
    side = 1.0 if missing > 0.0 else -1.0
    low, high = 0.0, abs(missing) / minimum
    reached = p[0] * side * high - exact_step(h, side * high, p[1], p[2], p[3], p[4]) + h
    if side * (reached - missing) <= 0.0:
        return side * high
    travel = min(abs(missing) / max(slope(h, side, p), minimum), high)
    for _ in range(_ITERATIONS):
        now = exact_step(h, side * travel, p[1], p[2], p[3], p[4])
        over = side * (p[0] * side * travel - now + h - missing)
        if over > 0.0:
            high = travel
        else:
            low = travel
        gradient = slope(now, side, p)
        step = over / gradient if gradient > 0.0 else 2.0 * high
        proposed = travel - step
        if not (low <= proposed <= high):
            proposed = 0.5 * (low + high)
        if proposed == travel or abs(proposed - travel) <= 1e-15 * (1.0 + travel):
            travel = proposed
            break
        travel = proposed
    return side * travel


@inline_jit
def invert_exact(
    w: FloatArray,
    u: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    minimum: float,
    low: float,
    high: float,
) -> None:
    """Solve the exact step for the voltage."""
    last, h = memory[U], memory[H]
    for k in range(w.size):
        missing = w[k] - p[0] * last + h
        new = last
        if missing != 0.0:
            if slope(h, 1.0 if missing > 0.0 else -1.0, p) < minimum:
                memory[CLAMPED] += 1.0
            new = last + solve_exact(missing, h, p, minimum)
        new = within_stroke(new, low, high, memory)
        h = exact_step(h, new - last, p[1], p[2], p[3], p[4])
        last = new
        u[k] = new
    memory[U], memory[H] = last, h


@inline_jit
def invert_gain(
    w: FloatArray,
    u: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    minimum: float,
    low: float,
    high: float,
) -> None:
    """Divide by a gain without memory."""
    for k in range(w.size):
        new = w[k] / p[0]
        new = within_stroke(new, low, high, memory)
        u[k] = new
        memory[U] = new


@inline_jit
def next_segment(
    u: float, side: float, plays: FloatArray, weights: FloatArray, spacing: float
) -> tuple[float, float]:
    """Return the total weight of the engaged plays, and the distance to the next one [V]."""
    weight, nearest = 0.0, np.inf
    slack = 1e-13 * (1.0 + abs(u))
    for j in range(plays.size):
        ahead = side * (plays[j] - u) + (j + 1) * spacing
        if ahead <= slack:
            weight += weights[j]
        elif ahead < nearest:
            nearest = ahead
    return weight, nearest


@inline_jit
def solve_plays(
    missing: float,
    u: float,
    plays: FloatArray,
    weights: FloatArray,
    w0: float,
    spacing: float,
    minimum: float,
) -> tuple[float, bool]:
    """Return the voltage at which a bank of plays has moved by `missing` [m].

    The bank is piecewise linear in the voltage and is solved segment by segment. The flag is set
    if the slope of a segment was clamped to `minimum`.
    """
    side = 1.0 if missing > 0.0 else -1.0
    left = abs(missing)
    clamped = False
    for _ in range(plays.size + 1):
        weight, ahead = next_segment(u, side, plays, weights, spacing)
        gradient = w0 + weight
        if gradient < minimum:
            gradient = minimum
            clamped = True
        if left <= gradient * ahead:
            return u + side * left / gradient, clamped
        left -= gradient * ahead
        u += side * ahead
    return u, clamped


@inline_jit
def invert_plays(
    w: FloatArray,
    u: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    minimum: float,
    low: float,
    high: float,
) -> None:
    """Solve the Prandtl-Ishlinskii model; p is range, w0, w1, ..., memory ends with the plays."""
    last, plays, weights = memory[U], memory[H:], p[2:]
    spacing = p[0] / (weights.size + 1)
    for k in range(w.size):
        now = p[1] * last
        for j in range(plays.size):
            now += weights[j] * plays[j]
        missing = w[k] - now
        new = last
        if missing != 0.0:
            new, clamped = solve_plays(missing, last, plays, weights, p[1], spacing, minimum)
            if clamped:
                memory[CLAMPED] += 1.0
        new = within_stroke(new, low, high, memory)
        bank(new, plays, weights, spacing, 1.0)
        last = new
        u[k] = new
    memory[U] = last
