"""Compiled sensitivities of a mode that is not linear: the derivative of every step.

Position, velocity and bristles of every row of derivatives are carried from step to step beside
the state: those of the input with respect to whatever comes from upstream, and those by the
block's own parameters, as many of them as are wanted.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.blocks._friction_mode import (
    Law,
    Transition,
    Triple,
    in_two,
    law_of,
    parts_of_a_step,
    parts_of_a_tick,
    transitions,
    turn,
    within,
)
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.jit import jit

_STATES = 3
_OWN = 7
# Places of the parameters without which the bristles do nothing, and are as Dahl's law has them,
# and how much of them counts then.
_FRICTION, _BREAKAWAY = 3, 5
_NONE, _DAHL, _STRIBECK = 0, 1, 2
_STEP = 1e-6  # of a difference, in units of what is usual; sqrt of the rounding, times some
# What a step knows of each parameter, and in the last row of none: transitions over half and the
# whole of it, and the squared pace, relative to itself; the forces that act back at start, middle,
# middle and end, and the bristles at the end.
_FULL, _SQUARE, _FORCES, _LAST = 4, 8, 9, 13
_COLUMNS = 14

Slope = tuple[float, float, float, float]
"""A force, and its derivatives by position, by that at the start of the step, by the bristles."""
Four = tuple[float, float, float, float]
Step = tuple[Triple, Four, tuple[Slope, Slope, Slope, Slope], tuple[float, float]]
"""Where a step ends; its accelerations, its forces; bristles at its end by bristles and move."""


@jit
def _timing(law: Law, h: float, direct: FloatArray) -> None:
    """Write the derivatives of the transitions by frequency and damping, shape (8, 14)."""
    omega = 2.0 * pi * law[0]
    for j in range(2):
        for part in range(2):
            step = 0.5 * h if part == 0 else h
            size = _STEP * (omega if j == 0 else max(law[1], 1e-3))
            up = hold(omega + size, law[1], step) if j == 0 else hold(omega, law[1] + size, step)
            low = hold(omega - size, law[1], step) if j == 0 else hold(omega, law[1] - size, step)
            unit = 2.0 * pi if j == 0 else 1.0
            first = _FULL * part
            direct[j, first] = unit * (up[0] - low[0]) / (2.0 * size)
            direct[j, first + 1] = unit * (up[1] - low[1]) / (2.0 * size)
            direct[j, first + 2] = unit * (up[2] - low[2]) / (2.0 * size)
            direct[j, first + 3] = unit * (up[3] - low[3]) / (2.0 * size)
    direct[0, _SQUARE] = 2.0 / law[0]


@jit
def _bristle(
    begun: float, move: float, time: float, law: Law, rubs: int
) -> tuple[float, float, float, float, float, float]:
    """Return `friction_state`; its derivatives by bristle, move and last three parameters."""
    sign = 1.0 if move > 0.0 else -1.0
    if time == 0.0:
        return begun, 1.0, 0.0, 0.0, 0.0, 0.0
    peak = speed = 0.0
    if rubs == _STRIBECK:
        speed = move / time / law[6]
        peak = exp(-(speed**2))
    limit = sign * (1.0 + (law[5] - 1.0) * peak)
    reach = law[4] * abs(limit)
    left = exp(-abs(move) / reach)
    apart = (begun - limit) * left
    by_limit = 1.0 - left + apart * abs(move) / reach / limit
    slope = -2.0 * sign * (law[5] - 1.0) * peak * speed
    return (
        limit + apart,
        left,
        by_limit * slope / (time * law[6]) - apart * sign / reach,
        apart * abs(move) / (reach * law[4]),
        by_limit * sign * peak,
        -by_limit * slope * speed / law[6],
    )


@jit
def _pull(
    x: float, begun: Triple, time: float, law: Law, rubs: int, direct: FloatArray, place: int
) -> Slope:
    """Return `pull` and its derivatives; those by parameters go to the column `place`."""
    share = law[2] * x * x
    inside = -1.0 < share < law[7]
    held = min(max(share, -1.0), law[7])
    force, by_x = held * x, 3.0 * share if inside else held
    direct[2, place] = x**3 if inside else 0.0
    if rubs == _NONE:
        return force, by_x, 0.0, 0.0
    found = _bristle(begun[2], x - begun[0], time, law, rubs)
    by_move = law[3] * found[2]
    direct[3, place] = found[0]
    direct[4, place] = law[3] * found[3]
    direct[5, place] = law[3] * found[4]
    direct[6, place] = law[3] * found[5]
    return force + law[3] * found[0], by_x + by_move, -by_move, law[3] * found[1]


@jit
def _change(slope: Slope, x: float, start: float, bristle: float, own: float) -> float:
    """Return how a force moves with position, start, bristles and a parameter."""
    return slope[1] * x + slope[2] * start + slope[3] * bristle + own


@jit
def _stages(
    f: Triple, begun: Triple, law: Law, h: float, over: tuple[Transition, Transition], rubs: int,
    direct: FloatArray,
) -> Step:  # fmt: skip
    """Take a step as `advance` does; the derivatives by parameters go to `direct`."""
    half, full = over
    square = (2.0 * pi * law[0]) ** 2
    x, v = begun[0] - f[1], begun[1]
    s1 = _pull(begun[0], begun, 0.0, law, rubs, direct, _FORCES)
    a1 = square * (f[0] - f[1] - s1[0])
    xh = half[0] * x + half[1] * v
    middle = xh + 0.5 * h * half[1] * a1 + f[1]
    s2 = _pull(middle, begun, 0.5 * h, law, rubs, direct, _FORCES + 1)
    s3 = _pull(xh + f[1], begun, 0.5 * h, law, rubs, direct, _FORCES + 2)
    a2, a3 = -square * s2[0], -square * s3[0]
    xf, vf = full[0] * x + full[1] * v, full[2] * x + full[3] * v
    s4 = _pull(xf + h * half[1] * a3 + f[1], begun, h, law, rubs, direct, _FORCES + 3)
    a4 = square * (f[2] - f[1] - s4[0])
    end = xf + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + f[1]
    speed = vf + h / 6.0 * (full[3] * a1 + 2.0 * half[3] * (a2 + a3) + a4)
    last = (begun[2], 1.0, 0.0)
    if rubs != _NONE:
        found = _bristle(begun[2], end - begun[0], h, law, rubs)
        direct[4, _LAST], direct[5, _LAST], direct[6, _LAST] = found[3], found[4], found[5]
        last = (found[0] if law[3] > 0.0 else begun[2], found[1], found[2])
    return (end, speed, last[0]), (a1, a2, a3, a4), (s1, s2, s3, s4), (last[1], last[2])


@jit
def _columns(
    step: Step, x: float, v: float, law: Law, h: float, over: tuple[Transition, Transition],
    direct: FloatArray, wanted: IntArray, inputs: FloatArray, moved: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives `moved`, shape (m + q, 3), through a step from position and velocity.

    `inputs`, shape (m, 3), is by how much the input moves at start, middle and end; the position
    is that from the input in the middle.
    """
    (h0, h1, _, h3), (f0, f1, f2, f3) = over
    _, (a1, a2, a3, a4), (s1, s2, s3, s4), (by_bristle, by_move) = step
    square, both = (2.0 * pi * law[0]) ** 2, a2 + a3
    m = inputs.shape[0]
    for j in range(moved.shape[0]):
        own = direct[_OWN if j < m else wanted[j - m]]
        u0 = u1 = u2 = 0.0
        if j < m:
            u0, u1, u2 = inputs[j, 0], inputs[j, 1], inputs[j, 2]
        x0, v0, b0 = moved[j, 0], moved[j, 1], moved[j, 2]
        k1, k3, g1, g3, s = own[1], own[3], own[_FULL + 1], own[_FULL + 3], own[_SQUARE]
        dx = x0 - u1
        dxh = h0 * dx + h1 * v0 + (own[0] * x + k1 * v) + u1
        dxf = f0 * dx + f1 * v0 + (own[_FULL] * x + g1 * v) + u1
        dvf = f2 * dx + f3 * v0 + (own[_FULL + 2] * x + g3 * v)
        d1 = s * a1 + square * (u0 - u1 - _change(s1, x0, 0.0, b0, own[_FORCES]))
        x2 = dxh + 0.5 * h * (h1 * d1 + k1 * a1)
        d2 = s * a2 - square * _change(s2, x2, x0, b0, own[_FORCES + 1])
        d3 = s * a3 - square * _change(s3, dxh, x0, b0, own[_FORCES + 2])
        x4 = dxf + h * (h1 * d3 + k1 * a3)
        d4 = s * a4 + square * (u2 - u1 - _change(s4, x4, x0, b0, own[_FORCES + 3]))
        sums, dboth = f1 * d1 + g1 * a1, d2 + d3
        end = dxf + h / 6.0 * (sums + 2.0 * (h1 * dboth + k1 * both))
        sums = f3 * d1 + g3 * a1
        moved[j, 0] = end
        moved[j, 1] = dvf + h / 6.0 * (sums + 2.0 * (h3 * dboth + k3 * both) + d4)
        moved[j, 2] = by_bristle * b0 + by_move * (end - x0) + own[_LAST]


@jit
def _part_of(inputs: FloatArray, begin: float, end: float, answer: FloatArray) -> None:
    """Fill `answer` with rows of inputs at start, middle and end of a part of a step."""
    for j in range(inputs.shape[0]):
        part = within((inputs[j, 0], inputs[j, 1], inputs[j, 2]), begin, end)
        answer[j, 0], answer[j, 1], answer[j, 2] = part


@jit
def _turned(
    f: Triple, begun: Triple, after: Triple, share: float, law: Law, h: float, rubs: int,
    timed: FloatArray, wanted: IntArray, inputs: FloatArray, whole: FloatArray, moved: FloatArray,
) -> Triple:  # fmt: skip
    """Take derivatives through a step in two parts, of which the first takes a `share`.

    As one step it would end `after`, with the derivatives `whole`.
    """
    # where it turns is moved by all that moves the velocities at the ends of the step
    fall, rows = begun[1] - after[1], moved.shape[0]
    later = np.empty(rows)
    for j in range(rows):
        later[j] = (begun[1] * whole[j, 1] - after[1] * moved[j, 1]) / (fall * fall)
    up = in_two(f, begun, law, h, share + _STEP)
    low = in_two(f, begun, law, h, share - _STEP)
    direct, part_of = timed.copy(), np.empty_like(inputs)
    for part in range(2):
        begin, end = (0.0, share) if part == 0 else (share, 1.0)
        time, given = (end - begin) * h, within(f, begin, end)
        shorter = transitions(law, time)
        _timing(law, time, direct)
        _part_of(inputs, begin, end, part_of)
        step = _stages(given, begun, law, time, shorter, rubs, direct)
        x, v = begun[0] - given[1], begun[1]
        _columns(step, x, v, law, time, shorter, direct, wanted, part_of, moved)
        begun = step[0]
    for j in range(rows):
        moved[j, 0] += (up[0] - low[0]) / (2.0 * _STEP) * later[j]
        moved[j, 1] += (up[1] - low[1]) / (2.0 * _STEP) * later[j]
        moved[j, 2] += (up[2] - low[2]) / (2.0 * _STEP) * later[j]
    return begun


@jit
def _turning(
    f: Triple, begun: Triple, law: Law, h: float, over: tuple[Transition, Transition], rubs: int,
    direct: FloatArray, wanted: IntArray, inputs: FloatArray, moved: FloatArray,
) -> Triple:  # fmt: skip
    """Take state and derivatives through a step as `turning` does the state."""
    step = _stages(f, begun, law, h, over, rubs, direct)
    after, x, v = step[0], begun[0] - f[1], begun[1]
    share = turn(begun[1], after[1], law)
    if share == 0.0:
        _columns(step, x, v, law, h, over, direct, wanted, inputs, moved)
        return after
    whole = moved.copy()
    _columns(step, x, v, law, h, over, direct, wanted, inputs, whole)
    return _turned(f, begun, after, share, law, h, rubs, direct, wanted, inputs, whole, moved)


@jit
def _rubbing(law: Law, wanted: IntArray) -> int:
    """Return how much of the friction counts."""
    rubs, brakes = law[3] > 0.0, law[5] > 1.0
    for place in wanted:
        rubs = rubs or place == _FRICTION
        brakes = brakes or place == _BREAKAWAY
    return (_STRIBECK if brakes else _DAHL) if rubs else _NONE


@jit
def carry(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, state: FloatArray,
    moved: FloatArray, p: FloatArray, wanted: IntArray, dt: float, points: int,
) -> None:  # fmt: skip
    """Respond as the block does, with the derivatives of its own steps, see `Block.carry`."""
    steps = max(1, points // 3)
    parts = parts_of_a_step(p, dt, steps) if points else parts_of_a_tick(p, dt)
    width = 3 if points else 1
    h = dt / (steps * parts)
    law = law_of(p, h)
    over = transitions(law, h)
    m, rows = dx.shape[0], moved.shape[0]
    rubs = _rubbing(law, wanted)
    direct = np.zeros((_OWN + 1, _COLUMNS))
    _timing(law, h, direct)
    inputs, given = np.empty((m, 3)), np.empty((m, 3))
    now = (state[0], state[1], state[2])
    for k in range(0, x.size, width):
        middle, end = (k + 1, k + 2) if points else (k, k)
        whole = (x[k], x[middle], x[end])
        for j in range(m):
            inputs[j, 0], inputs[j, 1], inputs[j, 2] = dx[j, k], dx[j, middle], dx[j, end]
        y[k] = now[0]
        for j in range(rows):
            dy[j, k] = moved[j, 0]
        for i in range(parts):
            begin, after = i / parts, (i + 1) / parts
            f = within(whole, begin, after) if points else whole
            _part_of(inputs, begin, after, given)
            now = _turning(f, now, law, h, over, rubs, direct, wanted, given, moved)
            if points and 2 * (i + 1) == parts:
                y[middle] = now[0]
                for j in range(rows):
                    dy[j, middle] = moved[j, 0]
        if points:
            y[end] = now[0]
            for j in range(rows):
                dy[j, end] = moved[j, 0]
    state[0], state[1], state[2] = now
