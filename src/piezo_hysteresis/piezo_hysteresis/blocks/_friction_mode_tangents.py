"""Compiled sensitivities of a mode that is not linear: the derivative of every step.

Position, velocity and bristles are three numbers. So the derivatives of one tick by them, by the
input and by the block's own parameters are eleven columns, whatever is carried along from
upstream, and are carried from step to step beside the state.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._friction_mode import (
    Transition,
    advance,
    in_two,
    parts_of_a_tick,
    transitions,
    turn,
    within,
)
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.jit import jit

_STATES = 3
_OWN = 7
# Directions: states, input, own parameters.
_INPUT = _STATES
_FIRST = _STATES + 1
_DIRECTIONS = _FIRST + _OWN
_STEP = 1e-6  # of a difference, in units of what is usual; sqrt of the rounding, times some
# Rows of what a step knows, a column per direction: transitions over half and the whole of it,
# and the squared pace, relative to itself.
_HALF, _FULL, _SQUARE = 0, 4, 8
_ROWS = 9
# Rows of the forces that act back, at start, middle, middle and end, and of the bristles at the
# end: a column per direction that the force names itself, then by position, by that at the start
# of the step, and by the bristles there.
_FORCES = 5
_BY_X, _BY_START, _BY_BRISTLE = _DIRECTIONS, _DIRECTIONS + 1, _DIRECTIONS + 2
_COLUMNS = _DIRECTIONS + 3

Triple = tuple[float, float, float]


@jit
def _timing(p: FloatArray, h: float, rows: FloatArray) -> None:
    """Write the derivatives of the transitions by frequency and damping, shape (9, 11)."""
    omega = 2.0 * pi * p[0]
    for j in range(2):
        for part in range(2):
            step = 0.5 * h if part == 0 else h
            size = _STEP * (omega if j == 0 else max(p[1], 1e-3))
            up = hold(omega + size, p[1], step) if j == 0 else hold(omega, p[1] + size, step)
            low = hold(omega - size, p[1], step) if j == 0 else hold(omega, p[1] - size, step)
            unit = 2.0 * pi if j == 0 else 1.0
            for i in range(4):
                rows[4 * part + i, _FIRST + j] = unit * (up[i] - low[i]) / (2.0 * size)
    rows[_SQUARE, _FIRST] = 2.0 * omega * 2.0 * pi / omega**2


@jit
def _bristle(
    begun: float, move: float, time: float, p: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Return `friction_state`; its derivatives by bristle, move and last three parameters."""
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
) -> float:  # fmt: skip
    """Return `pull`, and its derivatives in `row`, shape (14,)."""
    share = p[2] * x * x
    inside = -1.0 < share < stiffest
    force = min(max(share, -1.0), stiffest) * x
    by_x = 3.0 * share if inside else min(max(share, -1.0), stiffest)
    found = _bristle(begun[1], x - begun[0], time, p)
    row[_FIRST + 2] = x**3 if inside else 0.0
    row[_FIRST + 3] = found[0]
    for j in range(3):
        row[_FIRST + 4 + j] = p[3] * found[3 + j]
    by_move = p[3] * found[2]
    row[_BY_X], row[_BY_START], row[_BY_BRISTLE] = by_x + by_move, -by_move, p[3] * found[1]
    force += p[3] * found[0]
    return float(force)


@jit
def _stages(
    f: Triple, begun: Triple, p: FloatArray, h: float, over: tuple[Transition, Transition],
    stiffest: float, forces: FloatArray,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return the four accelerations of the step that `advance` takes from the state `begun`.

    Derivatives of the forces behind them, and of the bristles at the end, are in `forces`,
    shape (5, 14).
    """
    half, full = over
    square = (2.0 * pi * p[0]) ** 2
    x, v, start = begun[0] - f[1], begun[1], (begun[0], begun[2])
    a1 = square * (f[0] - f[1] - _pull(forces[0], begun[0], start, 0.0, p, stiffest))
    xh, xf = half[0] * x + half[1] * v, full[0] * x + full[1] * v
    x2 = xh + 0.5 * h * half[1] * a1
    a2 = -square * _pull(forces[1], x2 + f[1], start, 0.5 * h, p, stiffest)
    a3 = -square * _pull(forces[2], xh + f[1], start, 0.5 * h, p, stiffest)
    x4 = xf + h * half[1] * a3
    a4 = square * (f[2] - f[1] - _pull(forces[3], x4 + f[1], start, h, p, stiffest))
    end = xf + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + f[1]
    _, by_bristle, by_move, by_4, by_5, by_6 = _bristle(begun[2], end - begun[0], h, p)
    last = forces[4]
    last[_FIRST + 4], last[_FIRST + 5], last[_FIRST + 6] = by_4, by_5, by_6
    last[_BY_X], last[_BY_BRISTLE] = by_move, by_bristle
    return a1, a2, a3, a4


@jit
def _column(
    d: int, begun: Triple, f: Triple, a: tuple[float, float, float, float], p: FloatArray,
    h: float, over: tuple[Transition, Transition], timing: FloatArray, forces: FloatArray,
    moved: FloatArray,
) -> None:  # fmt: skip
    """Take the derivatives by direction `d` through the step whose `_stages` are `a`."""
    (h0, h1, _, h3), (f0, f1, f2, f3) = over
    square = (2.0 * pi * p[0]) ** 2
    x, v, u = begun[0] - f[1], begun[1], 1.0 if d == _INPUT else 0.0
    k1, k3 = timing[_HALF + 1, d], timing[_HALF + 3, d]
    g1, g3 = timing[_FULL + 1, d], timing[_FULL + 3, d]
    s = timing[_SQUARE, d]
    x0, v0, b0 = moved[0, d], moved[1, d], moved[2, d]
    dx = x0 - u
    dxh = h0 * dx + h1 * v0 + (timing[_HALF, d] * x + k1 * v)
    dxf = f0 * dx + f1 * v0 + (timing[_FULL, d] * x + g1 * v)
    dvf = f2 * dx + f3 * v0 + (timing[_FULL + 2, d] * x + g3 * v)
    d1 = s * a[0] - square * _slope(forces[0], x0, 0.0, b0, d)
    d2 = s * a[1] - square * _slope(
        forces[1], dxh + 0.5 * h * (h1 * d1 + k1 * a[0]) + u, x0, b0, d
    )
    d3 = s * a[2] - square * _slope(forces[2], dxh + u, x0, b0, d)
    d4 = s * a[3] - square * _slope(forces[3], dxf + h * (h1 * d3 + k1 * a[2]) + u, x0, b0, d)
    both, dboth = a[1] + a[2], d2 + d3
    inner1, inner3 = h1 * dboth + k1 * both, h3 * dboth + k3 * both
    end = dxf + u + h / 6.0 * (f1 * d1 + g1 * a[0] + 2.0 * inner1)
    moved[0, d] = end
    moved[1, d] = dvf + h / 6.0 * (f3 * d1 + g3 * a[0] + 2.0 * inner3 + d4)
    moved[2, d] = forces[4, _BY_BRISTLE] * b0 + forces[4, _BY_X] * (end - x0) + forces[4, d]


@jit
def _slope(row: FloatArray, dx: float, dx0: float, db: float, d: int) -> float:
    """Return how a force of `_pull` moves with position, start, bristles and direction `d`."""
    return float(row[_BY_X] * dx + row[_BY_START] * dx0 + row[_BY_BRISTLE] * db + row[d])


@jit
def _carried(
    f: Triple, begun: Triple, p: FloatArray, h: float, over: tuple[Transition, Transition],
    stiffest: float, timing: FloatArray, forces: FloatArray, moved: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives, shape (3, 11), through the step that `advance` takes from `begun`."""
    a = _stages(f, begun, p, h, over, stiffest, forces)
    for d in range(_DIRECTIONS):
        _column(d, begun, f, a, p, h, over, timing, forces, moved)


@jit
def _taken(state: FloatArray, begun: Triple) -> Triple:
    """Return what stands in `state`, and put `begun` there."""
    found = (state[0], state[1], state[2])
    state[0], state[1], state[2] = begun
    return found


@jit
def _turning(
    f: Triple, state: FloatArray, p: FloatArray, h: float, over: tuple[Transition, Transition],
    stiffest: float, timing: FloatArray, forces: FloatArray, moved: FloatArray,
) -> None:  # fmt: skip
    """Take state and derivatives through a step as `turning` does the state."""
    begun = (state[0], state[1], state[2])
    advance(f, state, p, h, over, stiffest)
    share = turn(begun[1], state[1], p)
    if share == 0.0:
        _carried(f, begun, p, h, over, stiffest, timing, forces, moved)
        return
    # where it turns is moved by all that moves the velocities at the ends of the step
    after, whole = _taken(state, begun), moved.copy()
    _carried(f, begun, p, h, over, stiffest, timing, forces, whole)
    fall = begun[1] - after[1]
    later = (begun[1] * whole[1] - after[1] * moved[1]) / (fall * fall)
    in_two(f, state, p, h, share + _STEP, stiffest)
    up = _taken(state, begun)
    in_two(f, state, p, h, share - _STEP, stiffest)
    low = _taken(state, begun)
    part_timing = np.zeros((_ROWS, _DIRECTIONS))
    for begin, end in ((0.0, share), (share, 1.0)):
        part, given = (end - begin) * h, within(f, begin, end)
        shorter = transitions(p, part)
        _timing(p, part, part_timing)
        begun = (state[0], state[1], state[2])
        _carried(given, begun, p, part, shorter, stiffest, part_timing, forces, moved)
        advance(given, state, p, part, shorter, stiffest)
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
    over = transitions(p, h)
    stiffest = 1.0 / (omega * h) ** 2
    timing = np.zeros((_ROWS, _DIRECTIONS))
    _timing(p, h, timing)
    forces, moved = np.zeros((_FORCES, _COLUMNS)), np.empty((_STATES, _DIRECTIONS))
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
            _turning(held, state, p, h, over, stiffest, timing, forces, moved)
        for j in range(m + _OWN):
            a, b, c = rows[j, 0], rows[j, 1], rows[j, 2]
            for i in range(_STATES):
                value = moved[i, 0] * a + moved[i, 1] * b + moved[i, 2] * c
                value += moved[i, _INPUT] * dx[j, k] if j < m else moved[i, _FIRST + j - m]
                rows[j, i] = value
