"""Compiled sensitivities: a block's output and its derivatives in one pass.

A tangent kernel ``(x, y, dx, dy, p, dt)`` answers the input x, shape (n,), from rest, as the block
does, and carries derivatives along: `dx`, shape (m, n), holds those of the input with respect to m
parameters upstream; it fills `dy`, shape (m + q, n), with those of the output, the block's own q
parameters last. One row after another runs through the recursion, because a short row of
derivatives per sample does not fill the pipeline. A block names its own as
`Block.tangent`; blocks without one are differenced numerically (see `sensitivities`).
"""

from __future__ import annotations

from math import copysign, exp, expm1, log1p, pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.jit import jit


@jit
def _hysteresis_rows(
    a1: float, factor: FloatArray, slope: FloatArray, dx: FloatArray, dy: FloatArray, x: FloatArray
) -> None:
    """Run ``dh+ = factor dh + forcing`` for every row; the forcing of the own rows is in `dy`."""
    m = dx.shape[0]
    for j in range(m):
        row = dx[j]
        dh = before = 0.0
        for k in range(x.size):
            dh = factor[k] * dh + slope[k] * (row[k] - before)
            before = row[k]
            dy[j, k] = a1 * before - dh
    d0 = d1 = d2 = d3 = 0.0
    for k in range(x.size):
        dy[m, k] = x[k]
        # side by side: one recursion waits for its own last value most of the time
        d0 = factor[k] * d0 + dy[m + 1, k]
        d1 = factor[k] * d1 + dy[m + 2, k]
        d2 = factor[k] * d2 + dy[m + 3, k]
        d3 = factor[k] * d3 + dy[m + 4, k]
        dy[m + 1, k], dy[m + 2, k], dy[m + 3, k], dy[m + 4, k] = -d0, -d1, -d2, -d3


@jit
def bouc_wen(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Euler step: dh+ = (1 - gamma sgn(h) du - beta |du|) dh + (what each parameter adds)."""
    a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
    m = dx.shape[0]
    factor = np.empty(x.size)
    slope = np.empty(x.size)
    last = h = 0.0
    for k in range(x.size):
        du = x[k] - last
        rise = abs(du)
        size = abs(h)
        factor[k] = 1.0 - gamma * copysign(1.0, h) * du - beta * rise
        slope[k] = a + copysign(a0, du) - gamma * size - copysign(beta, du) * h
        dy[m + 1, k] = du
        dy[m + 2, k] = rise
        dy[m + 3, k] = -rise * h
        dy[m + 4, k] = -size * du
        h += a * du + a0 * rise - gamma * size * du - beta * rise * h
        last = x[k]
        y[k] = a1 * last - h
    _hysteresis_rows(a1, factor, slope, dx, dy, x)


@jit
def _decay(h: float, c: float, kp: float, z: float) -> tuple[float, float, float, float]:
    """Solve dh/dz = c - kp h over z: h and its derivatives by the start, c and kp."""
    e = exp(-kp * z)
    if abs(kp * z) < 1e-5:
        by_c = z * (1.0 - 0.5 * kp * z)
        curve = z * z * (-0.5 + kp * z / 3.0)
    else:
        by_c = -expm1(-kp * z) / kp
        curve = (z * e - by_c) / kp
    return h * e + c * by_c, e, by_c, c * curve - z * h * e


@jit
def exact_step(
    h: float, z: float, c: float, toward: float, away: float
) -> tuple[float, float, float, float, float, float]:
    """Move h over the travel z and differentiate it.

    `c` is the drive, `toward` the rate while h runs against it, `away` the rate after h has
    passed zero. Returns h and its derivatives by h, c, toward, away and z.
    """
    if h * c >= 0.0:
        new, by_h, by_c, by_away = _decay(h, c, away, z)
        return new, by_h, by_c, 0.0, by_away, c - away * new
    ratio = toward * h / c
    flat = abs(ratio) < 1e-9
    needed = np.inf
    if ratio < 1.0:
        needed = -h / c if flat else log1p(-ratio) / toward
    if needed >= z:
        new, by_h, by_c, by_toward = _decay(h, c, toward, z)
        return new, by_h, by_c, by_toward, 0.0, c - toward * new
    new, _, by_c, by_away = _decay(0.0, c, away, z - needed)
    slope = c - away * new
    # the crossing itself moves with h, c and the first rate
    room = c - toward * h
    bend = 0.5 * h * h / (c * c) if flat else h / (toward * room) + needed / toward
    return new, slope / room, by_c - slope * h / (c * room), slope * bend, by_away, slope


@jit
def bouc_wen_exact(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Exact step of `blocks.bouc_wen_exact` and its derivatives."""
    a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
    m = dx.shape[0]
    factor = np.empty(x.size)
    slope = np.empty(x.size)
    last = h = 0.0
    for k in range(x.size):
        du = x[k] - last
        last = x[k]
        side = 1.0 if du > 0.0 else -1.0
        c = side * a + a0
        sign = side if c > 0.0 else -side
        h, by_h, by_c, by_toward, by_away, by_travel = exact_step(
            h, abs(du), c, beta - sign * gamma, beta + sign * gamma
        )
        factor[k] = by_h
        slope[k] = side * by_travel
        dy[m + 1, k] = side * by_c
        dy[m + 2, k] = by_c
        dy[m + 3, k] = by_toward + by_away
        dy[m + 4, k] = sign * (by_away - by_toward)
        y[k] = a1 * last - h
    _hysteresis_rows(a1, factor, slope, dx, dy, x)


@jit
def mode(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Run derivatives of the input through the mode itself, which is linear."""
    omega, damping = 2.0 * pi * p[0], p[1]
    f11, f12, f21, f22 = hold(omega, damping, dt)
    velocity = np.empty(x.size)
    q1 = q2 = 0.0
    for k in range(x.size):
        y[k] = q1
        velocity[k] = q2
        moved = f11 * q1 + f12 * q2 + (1.0 - f11) * x[k]
        q2 = f21 * q1 + f22 * q2 - f21 * x[k]
        q1 = moved
    m = dx.shape[0]
    _mode_rows(dx, dy, f11, f12, f21, f22)
    by_pace = _by_own(omega, damping, dt, 1e-6 * omega, 0.0)
    by_damping = _by_own(omega, damping, dt, 0.0, 1e-6 * damping)
    q1 = q2 = r1 = r2 = 0.0
    for k in range(x.size):
        dy[m, k], dy[m + 1, k] = q1, r1
        away = y[k] - x[k]
        moved = f11 * q1 + f12 * q2 + by_pace[0] * away + by_pace[1] * velocity[k]
        q2 = f21 * q1 + f22 * q2 + by_pace[2] * away + by_pace[3] * velocity[k]
        q1 = moved
        moved = f11 * r1 + f12 * r2 + by_damping[0] * away + by_damping[1] * velocity[k]
        r2 = f21 * r1 + f22 * r2 + by_damping[2] * away + by_damping[3] * velocity[k]
        r1 = moved


@jit
def _by_own(
    omega: float, damping: float, dt: float, s: float, r: float
) -> tuple[float, float, float, float]:
    """Differentiate the transition of a mode by its frequency [Hz] or its damping ratio.

    It is smooth: a central difference of its four numbers, over 2 `s` or 2 `r`, is good to ten
    digits.
    """
    u = hold(omega + s, damping + r, dt)
    v = hold(omega - s, damping - r, dt)
    width = s / pi if s != 0.0 else 2.0 * r
    return (
        (u[0] - v[0]) / width, (u[1] - v[1]) / width, (u[2] - v[2]) / width, (u[3] - v[3]) / width
    )  # fmt: skip


@jit
def _mode_rows(
    dx: FloatArray, dy: FloatArray, f11: float, f12: float, f21: float, f22: float
) -> None:
    """Run rows through a mode, four side by side: one waits for its own last value."""
    m, g1, g2 = dx.shape[0], 1.0 - f11, -f21
    for first in range(0, m, 4):
        i, j = first, min(first + 1, m - 1)
        s, t = min(first + 2, m - 1), min(first + 3, m - 1)
        a1 = a2 = b1 = b2 = c1 = c2 = d1 = d2 = 0.0
        for k in range(dx.shape[1]):
            a, b, c, d = dx[i, k], dx[j, k], dx[s, k], dx[t, k]
            dy[i, k], dy[j, k], dy[s, k], dy[t, k] = a1, b1, c1, d1
            a1, a2 = f11 * a1 + f12 * a2 + g1 * a, f21 * a1 + f22 * a2 + g2 * a
            b1, b2 = f11 * b1 + f12 * b2 + g1 * b, f21 * b1 + f22 * b2 + g2 * b
            c1, c2 = f11 * c1 + f12 * c2 + g1 * c, f21 * c1 + f22 * c2 + g2 * c
            d1, d2 = f11 * d1 + f12 * d2 + g1 * d, f21 * d1 + f22 * d2 + g2 * d


@jit
def autoregressive(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Run derivatives through the recursion, which is linear in its input and its past."""
    c1, c2 = p[0], p[1]
    m = dx.shape[0]
    n = x.size
    for j in range(m + 3):
        y1 = y2 = y3 = 0.0
        # the answer itself first, then the rows upstream, then those of c1 and c2
        for k in range(n):
            if j == 0:
                drive = x[k]
            elif j <= m:
                drive = dx[j - 1, k]
            else:
                lag = j - m + 1
                drive = y[k - lag] if k >= lag else 0.0
            new = y1 + c1 * y2 + c2 * y3 + drive
            y3 = y2
            y2 = y1
            y1 = new
            if j == 0:
                y[k] = new
            else:
                dy[j - 1, k] = new


@jit
def _line(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, factor: float, shift: float
) -> None:
    """Fill y and the rows of dy that come in with a straight line and its slope.

    In loops: an assignment of arrays takes seconds to compile, for the text of its errors.
    """
    for k in range(x.size):
        y[k] = factor * x[k] + shift
    for j in range(dx.shape[0]):
        for k in range(x.size):
            dy[j, k] = factor * dx[j, k]


@jit
def offset(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Add a constant."""
    _line(x, y, dx, dy, 1.0, p[0])
    dy[-1] = 1.0


@jit
def gain(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Multiply by a constant."""
    _line(x, y, dx, dy, p[0], 0.0)
    for k in range(x.size):
        dy[-1, k] = x[k]


@jit
def _bank_rows(
    x: FloatArray,
    y: FloatArray,
    dx: FloatArray,
    dy: FloatArray,
    weights: FloatArray,
    spacing: float,
    lowest: float,
    first: int,
) -> None:
    """Add a bank of plays to y and dy; row first + j is the answer of play j + 1.

    The thresholds are lowest spacing, (lowest + 1) spacing, ...
    """
    m = dx.shape[0]
    tied = np.zeros(m)
    for j in range(weights.size):
        half = (j + lowest) * spacing
        row = dy[first + j]
        memory = 0.0
        tied[:] = 0.0
        for k in range(x.size):
            low, high = x[k] - half, x[k] + half
            # a play that is pushed follows the derivative of its input, one at rest keeps its own
            if memory < low or memory > high:
                memory = low if memory < low else high
                for i in range(m):
                    tied[i] = dx[i, k]
            row[k] = memory
            y[k] += weights[j] * memory
            for i in range(m):
                dy[i, k] += weights[j] * tied[i]


@jit
def prandtl_ishlinskii(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    _straight(x, y, dx, dy, p)
    _bank_rows(x, y, dx, dy, p[2:], p[0] / (p.size - 1), 1.0, dx.shape[0] + 2)


@jit
def prandtl_ishlinskii_fine(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    _straight(x, y, dx, dy, p)
    _bank_rows(x, y, dx, dy, p[2:], p[0] / (p.size - 2), 0.5, dx.shape[0] + 2)


@jit
def _straight(x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray) -> None:
    """Begin with the weight without threshold, whose row comes behind that of the range."""
    m = dx.shape[0]
    _line(x, y, dx, dy, p[1], 0.0)
    dy[m] = 0.0
    for k in range(x.size):
        dy[m + 1, k] = x[k]


@jit
def nonlocal_memory(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    m = dx.shape[0]
    y[:] = 0.0
    dy[: m + 1] = 0.0
    _bank_rows(x, y, dx, dy, p[1:], p[0] / p.size, 1.0, m + 1)
