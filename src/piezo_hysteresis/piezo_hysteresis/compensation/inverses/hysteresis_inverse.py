"""Inverses of the hysteresis blocks, sample by sample: from w = A1 u - h to u.

``solve(w, memory, p, minimum)`` returns a voltage, ``follow(u, memory, p)`` moves the hysteresis
to the voltage as limited. The memory begins with the counters (clamped slopes, samples outside the
stroke), the last voltage and h. A slope below `minimum` is clamped and counted, and its sign is
kept.
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
def follow_euler(u: float, memory: FloatArray, p: FloatArray) -> None:
    """Move h by the papers' step."""
    memory[H] = euler_step(memory[H], u - memory[U], p)


@inline_jit
def euler(w: float, memory: FloatArray, p: FloatArray, minimum: float) -> float:
    """Solve the Euler step for the voltage, on the branch with the sign of the difference."""
    missing = w - p[0] * memory[U] + memory[H]
    side = 1.0 if missing > 0.0 else -1.0
    gradient = slope(memory[H], side, p)
    if gradient < minimum:
        gradient = minimum
        if missing != 0.0:
            memory[CLAMPED] += 1.0
    return float(memory[U] + missing / gradient)


@inline_jit
def delayed(w: float, memory: FloatArray, p: FloatArray, minimum: float) -> float:
    """Rakotondrabe's ``u[k] = (w[k] + h[k-1]) / A1``, Fujii 2018 (14), Zhou 2021 (8)."""
    return float((w + memory[H]) / p[0])


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
def exact(w: float, memory: FloatArray, p: FloatArray, minimum: float) -> float:
    """Solve the exact step for the voltage."""
    last, h = memory[U], memory[H]
    missing = w - p[0] * last + h
    if missing == 0.0:
        return float(last)
    if slope(h, 1.0 if missing > 0.0 else -1.0, p) < minimum:
        memory[CLAMPED] += 1.0
    return float(last + solve_exact(missing, h, p, minimum))


@inline_jit
def follow_exact(u: float, memory: FloatArray, p: FloatArray) -> None:
    """Move h by the exact step."""
    memory[H] = exact_step(memory[H], u - memory[U], p[1], p[2], p[3], p[4])


@inline_jit
def gain(w: float, memory: FloatArray, p: FloatArray, minimum: float) -> float:
    """Divide by a gain."""
    return float(w / p[0])


@inline_jit
def follow_nothing(u: float, memory: FloatArray, p: FloatArray) -> None:
    """Remember nothing."""


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
def plays(w: float, memory: FloatArray, p: FloatArray, minimum: float) -> float:
    """Solve the Prandtl-Ishlinskii model; p is range, w0, w1, ..., memory ends with the plays."""
    last, states, weights = memory[U], memory[H:], p[2:]
    now = p[1] * last
    for j in range(states.size):
        now += weights[j] * states[j]
    missing = w - now
    if missing == 0.0:
        return float(last)
    spacing = p[0] / (weights.size + 1)
    new, clamped = solve_plays(missing, last, states, weights, p[1], spacing, minimum)
    if clamped:
        memory[CLAMPED] += 1.0
    return float(new)


@inline_jit
def follow_plays(u: float, memory: FloatArray, p: FloatArray) -> None:
    """Move the plays."""
    bank(u, memory[H:], p[2:], p[0] / (p.size - 1), 1.0)


#: Of each law what solves and what follows.
KERNELS = {
    'exact': (exact, follow_exact),
    'euler': (euler, follow_euler),
    'delayed': (delayed, follow_euler),
    'plays': (plays, follow_plays),
    'gain': (gain, follow_nothing),
}
