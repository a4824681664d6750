"""Compiled kernels of the papers' recursive least squares.

`theta` holds a1, a2, A1, A, A0, beta, gamma, then the constant and the four harmonic columns where
they are on; `p` the covariance, `w` work space, `m` the memory and `c` the settings.
"""

from __future__ import annotations

from math import cos, isfinite, nan, sin, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit

_TRACE_MAX = 1e3  # mean of the diagonal of P at which forgetting rests; P0 = I has 1

# Places in the memory of the recursion (m) and in its settings (c).
SAMPLES, _Y1, _Y2, _Y3, _U1, _H, _SU, _SV, _SB, _SG, _Z1, _Z2, _Z3 = range(13)
ERROR_SUM, WEIGHT_SUM, MEMORY = 13, 14, 15
_VARIANT, _OFFSET, _HARMONIC, _OMEGA, FORGETTING = range(5)


@jit
def _regressor(u: float, y: float, x: FloatArray, m: FloatArray, c: FloatArray) -> float:
    """Fill x with the columns of 000 (10) or 001 (10) and return the target."""
    du = u - m[_U1]
    travel = abs(du)
    m[_SU] += du
    m[_SV] += travel
    m[_SB] += travel * m[_H]
    m[_SG] += abs(m[_H]) * du
    sign = 1.0 if c[_VARIANT] == 2.0 else -1.0
    # With a harmonic, V1 regresses on y1 = y - y3 as 000 (6) says; y3 is zero otherwise.
    if c[_VARIANT] == 0.0:
        x[0], x[1], target = m[_Y1], m[_Y2], y
    elif c[_VARIANT] == 1.0:
        x[0], x[1], target = m[_Y2] - m[_Z2], m[_Y3] - m[_Z3], y - m[_Y1]
    else:
        x[0], x[1], target = m[_Y2], m[_Y1], y - m[_Y1]
    x[2] = u
    x[3] = sign * m[_SU]
    x[4] = sign * m[_SV]
    x[5] = m[_SB]
    x[6] = m[_SG]
    n = 7
    if c[_OFFSET] == 1.0:
        x[n] = 1.0
        n += 1
    if c[_HARMONIC] > 0.0:
        phase = c[_OMEGA] * m[SAMPLES]
        x[n], x[n + 1], x[n + 2], x[n + 3] = m[_Z2], m[_Z3], sin(phase), cos(phase)
    return target


@jit
def _gain(
    x: FloatArray, theta: FloatArray, p: FloatArray, g: FloatArray, error: float, forgetting: float
) -> None:
    """Do the RLS step itself: theta and P in place, g as work space."""
    n = theta.size
    s = forgetting
    for i in range(n):
        g[i] = 0.0
    # P is symmetric to the bit, so its rows serve as columns and the inner loop has no carry.
    for j in range(n):
        for i in range(n):
            g[i] += p[j, i] * x[j]
    for i in range(n):
        s += g[i] * x[i]
    step = error / s
    root = sqrt(1.0 / s)
    for i in range(n):
        theta[i] += g[i] * step
        g[i] *= root
    for i in range(n):
        for j in range(n):
            p[i, j] -= g[i] * g[j]
    if forgetting < 1.0:
        _forget(p, forgetting)


@jit
def _forget(p: FloatArray, forgetting: float) -> None:
    """Inflate P; it rests above a bound, because without excitation it would grow for ever."""
    n = p.shape[0]
    trace = 0.0
    for i in range(n):
        trace += p[i, i]
    if trace < _TRACE_MAX * n:
        grow = 1.0 / forgetting
        for i in range(n):
            for j in range(n):
                p[i, j] *= grow


@jit
def _remember(
    u: float, y: float, x: FloatArray, theta: FloatArray, m: FloatArray, c: FloatArray
) -> None:
    """Move the hysteresis, the harmonic and the shift registers on by one sample."""
    du = u - m[_U1]
    h = m[_H]
    a0 = -theta[4] if c[_VARIANT] == 2.0 else theta[4]
    m[_H] = h + theta[3] * du + a0 * abs(du) - theta[6] * abs(h) * du - theta[5] * abs(du) * h
    if c[_HARMONIC] > 0.0:
        n = theta.size - 4
        z = m[_Z1]
        for i in range(n, n + 4):
            z += theta[i] * x[i]
        m[_Z1], m[_Z2], m[_Z3] = z, m[_Z1], m[_Z2]
    m[_Y1], m[_Y2], m[_Y3] = y, m[_Y1], m[_Y2]
    m[_U1] = u
    m[SAMPLES] += 1.0


@jit
def update(
    u: float,
    y: float,
    theta: FloatArray,
    p: FloatArray,
    w: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> float:
    """Take one sample in (y in the working unit) and return the one-step error."""
    if not (isfinite(u) and isfinite(y)):
        return nan  # a lost sample is skipped: one NaN in P would stay for ever
    x, g = w[0], w[1]
    error = _regressor(u, y, x, m, c)
    for i in range(theta.size):
        error -= theta[i] * x[i]
    _gain(x, theta, p, g, error, c[FORGETTING])
    _remember(u, y, x, theta, m, c)
    m[ERROR_SUM] = c[FORGETTING] * m[ERROR_SUM] + error * error
    m[WEIGHT_SUM] = c[FORGETTING] * m[WEIGHT_SUM] + 1.0
    return error


@jit
def update_many(
    u: FloatArray,
    y: FloatArray,
    scale: float,
    errors: FloatArray,
    theta: FloatArray,
    p: FloatArray,
    w: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    """Take samples in, y and errors in metres, `scale` working units to the metre."""
    for k in range(u.size):
        errors[k] = update(u[k], y[k] * scale, theta, p, w, m, c) / scale


@jit
def free_run(u: FloatArray, y: FloatArray, theta: FloatArray, c: FloatArray) -> None:
    """Simulate the model of the variant from rest with fixed parameters."""
    u1 = h = y1 = y2 = y3 = z1 = z2 = z3 = 0.0
    a0 = -theta[4] if c[_VARIANT] == 2.0 else theta[4]
    last = theta.size - 4
    for k in range(u.size):
        du = u[k] - u1
        travel = abs(du)
        h += theta[3] * du + a0 * travel - theta[6] * abs(h) * du - theta[5] * travel * h
        v = theta[2] * u[k] - h
        if c[_OFFSET] == 1.0:
            v += theta[7]
        # y is the recursion without the harmonic (V1, V2: y1 of 000 (6)), z the harmonic.
        if c[_VARIANT] == 0.0:
            value = theta[0] * y1 + theta[1] * y2 + v
        else:
            value = y1 + theta[0] * y2 + theta[1] * y3 + v
        y3, y2, y1, u1 = y2, y1, value, u[k]
        y[k] = value
        if c[_HARMONIC] > 0.0:
            phase = c[_OMEGA] * k
            drive = theta[last + 2] * sin(phase) + theta[last + 3] * cos(phase)
            z = z1 + theta[last] * z2 + theta[last + 1] * z3 + drive
            if c[_VARIANT] == 0.0:
                # V0 adds the harmonic inside the recursion of the total y.
                y[k] += theta[last] * z2 + theta[last + 1] * z3 + drive
                y1 = y[k]
            else:
                y[k] += z
            z3, z2, z1 = z2, z1, z
