"""Compiled sensitivities of a mode that is not linear: the derivative of every step.

Position, velocity and bristles are three numbers. So the derivatives of one tick by them, by the
input and by the block's own parameters are eleven columns, whatever is carried along from
upstream, and are carried from step to step beside the state.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._rubbing import advance, in_two, parts_of_a_tick, turn, within
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.jit import jit

_STATES = 3
_OWN = 7
# Directions: states, input, own parameters.
_INPUT = _STATES
_FIRST = _STATES + 1
_DIRECTIONS = _FIRST + _OWN
_STEP = 1e-6  # of a difference, in units of what is usual; sqrt of the rounding, times some
# Rows of what a step knows: transitions over half and the whole of it, and the squared pace.
_HALF, _FULL, _SQUARE = 0, 4, 8
_ROWS = 9
# Rows of the forces that act back, at start, middle, middle and end, and of the bristles.
_FORCES = 5


@jit
def _timing(p: FloatArray, h: float, rows: FloatArray) -> None:
    """Write the derivatives of the transitions by frequency and damping, shape (9, 2)."""
    omega = 2.0 * pi * p[0]
    for j in range(2):
        for part in range(2):
            step = 0.5 * h if part == 0 else h
            size = _STEP * (omega if j == 0 else max(p[1], 1e-3))
            up = hold(omega + size, p[1], step) if j == 0 else hold(omega, p[1] + size, step)
            low = hold(omega - size, p[1], step) if j == 0 else hold(omega, p[1] - size, step)
            unit = 2.0 * pi if j == 0 else 1.0
            for i in range(4):
                rows[4 * part + i, j] = unit * (up[i] - low[i]) / (2.0 * size)
    rows[_SQUARE, 0], rows[_SQUARE, 1] = 2.0 * omega * 2.0 * pi, 0.0


@jit
def _bristle(
    begun: float, move: float, time: float, p: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Return `rubbed`, and its derivatives by bristle, move and the last three parameters."""
    sign = 1.0 if move > 0.0 else -1.0
    if time == 0.0:
        return begun, 1.0, 0.0, 0.0, 0.0, 0.0
    speed = move / time / p[6]
    peak = exp(-(speed**2))
    limit = sign * (1.0 + (p[5] - 1.0) * peak)
    reach = p[4] * abs(limit)
    left = exp(-abs(move) / reach)
    apart = (begun - limit) * left
    by_limit = 1.0 - left + apart * abs(move) / reach / limit
    slope = -2.0 * sign * (p[5] - 1.0) * peak * speed
    return (
        limit + apart,
        left,
        by_limit * slope / (time * p[6]) - apart * sign / reach,
        apart * abs(move) / (reach * p[4]),
        by_limit * sign * peak,
        -by_limit * slope * speed / p[6],
    )


@jit
def _pull(
    row: FloatArray, x: float, begun: tuple[float, float], time: float, p: FloatArray,
    stiffest: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return `pull`, and its derivatives by position, start and bristle; own ones into `row`."""
    share = p[2] * x * x
    inside = -1.0 < share < stiffest
    force = min(max(share, -1.0), stiffest) * x
    by_x = 3.0 * share if inside else min(max(share, -1.0), stiffest)
    found = _bristle(begun[1], x - begun[0], time, p)
    row[2] = x**3 if inside else 0.0
    row[3] = found[0]
    for j in range(3):
        row[4 + j] = p[3] * found[3 + j]
    by_move = p[3] * found[2]
    return force + p[3] * found[0], by_x + by_move, -by_move, p[3] * found[1]


@jit
def _carried(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    half: tuple[float, float, float, float],
    full: tuple[float, float, float, float],
    stiffest: float,
    timing: FloatArray,
    forces: FloatArray,
    moved: FloatArray,
) -> None:
    """Take derivatives, shape (3, 11), through the step that `advance` takes from `state`."""
    square = (2.0 * pi * p[0]) ** 2
    begun = (state[0], state[2])
    x, v = state[0] - f[1], state[1]
    p1, p1x, _, p1b = _pull(forces[0], state[0], begun, 0.0, p, stiffest)
    a1 = square * (f[0] - f[1] - p1)
    xh = half[0] * x + half[1] * v
    x2 = xh + 0.5 * h * half[1] * a1
    p2, p2x, p20, p2b = _pull(forces[1], x2 + f[1], begun, 0.5 * h, p, stiffest)
    p3, p3x, p30, p3b = _pull(forces[2], xh + f[1], begun, 0.5 * h, p, stiffest)
    a2, a3 = -square * p2, -square * p3
    x4 = full[0] * x + full[1] * v + h * half[1] * a3
    p4, p4x, p40, p4b = _pull(forces[3], x4 + f[1], begun, h, p, stiffest)
    end = full[0] * x + full[1] * v + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + f[1]
    _, by_b, by_move, forces[4, 4], forces[4, 5], forces[4, 6] = _bristle(
        state[2], end - state[0], h, p
    )
    for d in range(_DIRECTIONS):
        own = d - _FIRST
        u = 1.0 if d == _INPUT else 0.0
        x0, v0, b0 = moved[0, d], moved[1, d], moved[2, d]
        dx = x0 - u
        h1, h3 = half[1], half[3]
        dxh, dvf = half[0] * dx + half[1] * v0, full[2] * dx + full[3] * v0
        dxf = full[0] * dx + full[1] * v0
        s, k1, k3, f1, f3 = 0.0, 0.0, 0.0, 0.0, 0.0
        o1, o2, o3, o4, o5 = 0.0, 0.0, 0.0, 0.0, 0.0
        if own >= 0:
            o1, o2, o3 = forces[0, own], forces[1, own], forces[2, own]
            o4, o5 = forces[3, own], forces[4, own]
        if own == 0 or own == 1:
            k1, k3, s = timing[_HALF + 1, own], timing[_HALF + 3, own], timing[_SQUARE, own]
            f1, f3 = timing[_FULL + 1, own], timing[_FULL + 3, own]
            dxh += timing[_HALF, own] * x + k1 * v
            dxf += timing[_FULL, own] * x + f1 * v
            dvf += timing[_FULL + 2, own] * x + f3 * v
        d1 = s / square * a1 - square * (p1x * x0 + p1b * b0 + o1)
        dx2 = dxh + 0.5 * h * (h1 * d1 + k1 * a1)
        d2 = s / square * a2 - square * (p2x * (dx2 + u) + p20 * x0 + p2b * b0 + o2)
        d3 = s / square * a3 - square * (p3x * (dxh + u) + p30 * x0 + p3b * b0 + o3)
        dx4 = dxf + h * (h1 * d3 + k1 * a3)
        a4 = square * (f[2] - f[1] - p4)
        d4 = s / square * a4 - square * (p4x * (dx4 + u) + p40 * x0 + p4b * b0 + o4)
        both, dboth = a2 + a3, d2 + d3
        inner1, inner3 = h1 * dboth + k1 * both, h3 * dboth + k3 * both
        dend = dxf + u + h / 6.0 * (full[1] * d1 + f1 * a1 + 2.0 * inner1)
        moved[0, d] = dend
        moved[1, d] = dvf + h / 6.0 * (full[3] * d1 + f3 * a1 + 2.0 * inner3 + d4)
        moved[2, d] = by_b * b0 + by_move * (dend - x0) + o5


@jit
def _turning(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    half: tuple[float, float, float, float],
    full: tuple[float, float, float, float],
    stiffest: float,
    timing: FloatArray,
    forces: FloatArray,
    moved: FloatArray,
) -> None:
    """Take state and derivatives through a step as `turning` does the state."""
    after = state.copy()
    advance(f, after, p, h, half, full, stiffest)
    share = turn(state[1], after[1], p)
    if share == 0.0:
        _carried(f, state, p, h, half, full, stiffest, timing, forces, moved)
        state[:] = after
        return
    # where it turns is moved by all that moves the velocities at the ends of the step
    whole = moved.copy()
    _carried(f, state, p, h, half, full, stiffest, timing, forces, whole)
    fall = state[1] - after[1]
    later = (state[1] * whole[1] - after[1] * moved[1]) / (fall * fall)
    up, low = state.copy(), state.copy()
    in_two(f, up, p, h, share + _STEP, stiffest)
    in_two(f, low, p, h, share - _STEP, stiffest)
    omega, part_timing = 2.0 * pi * p[0], np.empty((_ROWS, 2))
    for begin, end in ((0.0, share), (share, 1.0)):
        part, given = (end - begin) * h, within(f, begin, end)
        first, both = hold(omega, p[1], 0.5 * part), hold(omega, p[1], part)
        _timing(p, part, part_timing)
        _carried(given, state, p, part, first, both, stiffest, part_timing, forces, moved)
        advance(given, state, p, part, first, both, stiffest)
    for i in range(_STATES):
        slope = (up[i] - low[i]) / (2.0 * _STEP)
        for d in range(_DIRECTIONS):
            moved[i, d] += slope * later[d]


@jit
def nonlinear_mode(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Respond as the block does, with the derivatives of its own steps."""
    m, parts = dx.shape[0], parts_of_a_tick(p, dt)
    h = dt / parts
    omega = 2.0 * pi * p[0]
    half, full = hold(omega, p[1], 0.5 * h), hold(omega, p[1], h)
    stiffest = 1.0 / (omega * h) ** 2
    timing = np.empty((_ROWS, 2))
    _timing(p, h, timing)
    forces, moved = np.zeros((_FORCES, _OWN)), np.empty((_STATES, _DIRECTIONS))
    state, rows = np.zeros(_STATES), np.zeros((m + _OWN, _STATES))
    for k in range(x.size):
        y[k] = state[0]
        for j in range(m + _OWN):
            dy[j, k] = rows[j, 0]
        moved[:] = 0.0
        for i in range(_STATES):
            moved[i, i] = 1.0
        held = (x[k], x[k], x[k])
        for _ in range(parts):
            _turning(held, state, p, h, half, full, stiffest, timing, forces, moved)
        for j in range(m + _OWN):
            a, b, c = rows[j, 0], rows[j, 1], rows[j, 2]
            for i in range(_STATES):
                value = moved[i, 0] * a + moved[i, 1] * b + moved[i, 2] * c
                value += moved[i, _INPUT] * dx[j, k] if j < m else moved[i, _FIRST + j - m]
                rows[j, i] = value
