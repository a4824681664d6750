"""Compiled kernels of the well-posed recursions: Bierman's UD filter and two regressors.

All quantities are in units of the ranges in the settings, so that the same initial values suit
every actuator. `m` is the memory, `c` the settings (indices below); `q`, shape (d, 2), holds the
state of the mode for each of the d dynamic columns.
"""

from __future__ import annotations

from math import isfinite, nan

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._plays import play
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.jit import jit, leaf
from piezo_hysteresis.kernels.forward import jacobian

SAMPLES, LAST, H, H_BETA, H_GAMMA, H_MAX, TRAVEL, ACTIVITY = range(8)
ERROR_SUM, WEIGHT_SUM, LEARNT, PROJECTED, PLAYS = 8, 9, 10, 11, 12
KIND, MODE, A11, A12, A21, A22, FORGETTING, QUIET, SMOOTH = range(9)
BOUC_WEN, PLAY_BANK = 0.0, 1.0

MARGIN = 0.05  # smallest slope of the model after a reversal, over its gain
_BOX = 50.0  # bound of gain and shape in units of the ranges
_STEP = 0.02  # largest relative change of the shape in one update
_SHORTEST = 16.0  # shortest memory with forgetting [ranges travelled]: four full cycles
_FIRST, _GROWTH = 8.0, 0.25  # memory at the start [ranges travelled], and its growth
_SETTLED = 4.0  # travel in ranges, one full cycle, before the shape is estimated

_step = jacobian(exact_step)


@leaf
def bierman(
    theta: FloatArray,
    u: FloatArray,
    d: FloatArray,
    x: FloatArray,
    w: FloatArray,
    forgetting: float,
) -> float:
    """Update P = U diag(d) U' for the column x; leave the gain in w[1] and return its divisor.

    The noise of one sample has variance one. Square roots and differences of P are avoided, so P
    stays positive definite whatever the rounding (Bierman 1977).
    """
    n = x.size
    f, b = w[0], w[1]
    for i in range(n):
        total = x[i]
        for j in range(i):
            total += u[j, i] * x[j]
        f[i] = total
    a: float = forgetting
    for j in range(n):
        g = d[j] * f[j]
        before = a
        a += f[j] * g
        d[j] *= before / a
        b[j] = g
        share = -f[j] / before
        for i in range(j):
            old = u[i, j]
            u[i, j] = old + b[i] * share
            b[i] += old * g
    return a


@leaf
def _bouc_wen_columns(u: float, theta: FloatArray, m: FloatArray, v: FloatArray) -> None:
    """Fill v with u, -h and the derivatives by beta and gamma, for h of unit A."""
    du = u - m[LAST]
    if du != 0.0:
        h, by_h, _, _, _, by_beta, by_gamma = _step(m[H], du, 1.0, 0.0, theta[2], theta[3])
        m[H] = h
        m[H_BETA] = by_h * m[H_BETA] + by_beta
        m[H_GAMMA] = by_h * m[H_GAMMA] + by_gamma
        m[H_MAX] = max(m[H_MAX], abs(h))
    v[0] = u
    v[1] = -m[H]
    v[2] = -theta[1] * m[H_BETA]
    v[3] = -theta[1] * m[H_GAMMA]


@leaf
def _play_columns(u: float, m: FloatArray, v: FloatArray) -> None:
    """Fill v with u and the plays at a tenth of the range, two tenths, ..."""
    v[0] = u
    for j in range(1, v.size):
        place = PLAYS + j - 1
        m[place] = play(u, m[place], 0.1 * j)
        v[j] = m[place]


@leaf
def _through_mode(x: FloatArray, v: FloatArray, q: FloatArray, c: FloatArray) -> None:
    """Filter each column by the fixed mode, sampled before the new hold acts."""
    if c[MODE] == 0.0:
        for i in range(v.size):
            x[i] = v[i]
        return
    for i in range(v.size):
        x[i] = q[i, 0]
        moved = c[A11] * q[i, 0] + c[A12] * q[i, 1] + (1.0 - c[A11]) * v[i]
        q[i, 1] = c[A21] * q[i, 0] + c[A22] * q[i, 1] - c[A21] * v[i]
        q[i, 0] = moved


@leaf
def _project_bouc_wen(theta: FloatArray, m: FloatArray) -> None:
    """Project onto a decaying h (beta > |gamma|) and a positive slope after reversals."""
    theta[0] = min(max(theta[0], -_BOX), _BOX)
    theta[2] = min(max(theta[2], 1.0 / _BOX), _BOX)
    theta[3] = min(max(theta[3], -0.95 * theta[2]), 0.95 * theta[2])
    steepest = 1.0 + (theta[2] - theta[3]) * m[H_MAX]
    most = (1.0 - MARGIN) * theta[0] / steepest
    low, high = min(0.0, most), max(0.0, most)
    if theta[1] < low or theta[1] > high:
        theta[1] = min(max(theta[1], low), high)
        m[PROJECTED] += 1.0


@leaf
def update(
    u: float,
    y: float,
    theta: FloatArray,
    factor: FloatArray,
    d: FloatArray,
    d_max: FloatArray,
    w: FloatArray,
    q: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> float:
    """Update with one sample in units of the ranges; return the prediction error."""
    if not isfinite(u):
        u = m[LAST]
    n = theta.size
    x, v = w[2], w[3][: n - 1]
    moved = abs(u - m[LAST])
    if c[KIND] == BOUC_WEN:
        _bouc_wen_columns(u, theta, m, v)
    else:
        _play_columns(u, m, v)
    _through_mode(x, v, q, c)
    x[n - 1] = 1.0
    m[LAST] = u
    m[SAMPLES] += 1.0
    m[TRAVEL] += moved
    m[ACTIVITY] += c[SMOOTH] * (moved - m[ACTIVITY])
    error: float = y - theta[n - 1]
    linear = 2 if c[KIND] == BOUC_WEN else n - 1
    for i in range(linear):
        error -= theta[i] * x[i]
    if not isfinite(error):
        return nan
    m[ERROR_SUM] = c[FORGETTING] * m[ERROR_SUM] + error * error
    m[WEIGHT_SUM] = c[FORGETTING] * m[WEIGHT_SUM] + 1.0
    if m[ACTIVITY] < c[QUIET]:
        return error  # an actuator at rest shows only its noise
    if c[KIND] == BOUC_WEN and m[TRAVEL] < _SETTLED:
        x[2] = x[3] = 0.0
    _learn(error, theta, factor, d, d_max, w, m, c)
    return error


@leaf
def _learn(
    error: float,
    theta: FloatArray,
    factor: FloatArray,
    d: FloatArray,
    d_max: FloatArray,
    w: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    n = theta.size
    gain = w[1]
    # a loop is determined by a few cycles, so the memory is never shorter
    speed = min(m[ACTIVITY], 1.0)
    forgetting = max(c[FORGETTING], 1.0 - speed / _SHORTEST)
    if c[KIND] == BOUC_WEN:
        # samples before the shape has converged are discounted faster (Ljung)
        forgetting *= 1.0 - speed / (_FIRST + _GROWTH * m[TRAVEL])
    divisor = bierman(theta, factor, d, w[2], w, forgetting)
    step = error / divisor
    if c[KIND] == BOUC_WEN:
        # the shape enters nonlinearly: the step is limited to the range of the linearisation
        most = _STEP * theta[2]
        for i in range(2, 4):
            if abs(gain[i] * step) > most:
                step *= most / abs(gain[i] * step)
    for i in range(n):
        theta[i] += gain[i] * step
        d[i] = min(d[i] / forgetting, d_max[i])
    if c[KIND] == BOUC_WEN:
        _project_bouc_wen(theta, m)


@jit
def update_many(
    u: FloatArray,
    y: FloatArray,
    errors: FloatArray,
    theta: FloatArray,
    factor: FloatArray,
    d: FloatArray,
    d_max: FloatArray,
    w: FloatArray,
    q: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    """Update with samples in units of the ranges."""
    for k in range(u.size):
        errors[k] = update(u[k], y[k], theta, factor, d, d_max, w, q, m, c)
