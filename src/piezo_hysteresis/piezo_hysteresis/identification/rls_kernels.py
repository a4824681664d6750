"""Compiled kernels of the papers' recursive least squares.

`theta` holds a1, a2, A1, A, A0, beta, gamma, then the constant and the four harmonic columns if
enabled; `p` the covariance, `x` the regressor, `g` the gain, `m` the memory, `c` the settings.
"""

from __future__ import annotations

from math import cos, isfinite, nan, sin, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit, leaf

_TRACE_MAX = 1e3  # mean of the diagonal of P above which forgetting is suspended; P0 = I has 1

# Indices in the memory (m) and in the settings (c).
SAMPLES, ERROR_SUM, WEIGHT_SUM, MEMORY = 0, 13, 14, 15
BASIC = 3.0  # number of the variant without recursion and A0
_VARIANT, _OFFSET, _HARMONIC, OMEGA, FORGETTING, PHASE = range(6)


@leaf
def _gain(
    x: FloatArray, theta: FloatArray, p: FloatArray, g: FloatArray, error: float, forgetting: float
) -> None:
    """Update theta and P in place by one RLS step, with g as work space."""
    n = theta.size
    s = forgetting
    # P is exactly symmetric, so its rows are used as columns and the inner loop vectorises
    for i in range(n):
        g[i] = p[0, i] * x[0]
    for j in range(1, n):
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
        _inflate(p, forgetting)


@leaf
def _inflate(p: FloatArray, forgetting: float) -> None:
    """Inflate P up to a bound, because without excitation it would grow indefinitely."""
    n = p.shape[0]
    trace = 0.0
    for i in range(n):
        trace += p[i, i]
    if trace < _TRACE_MAX * n:
        grow = 1.0 / forgetting
        for i in range(n):
            for j in range(n):
                p[i, j] *= grow


@leaf
def _lags(
    y: float, y1: float, y2: float, y3: float, z2: float, z3: float, variant: float
) -> tuple[float, float, float]:
    """Return autoregressive columns and target by the number of the variant.

    They are from Fujii 2018 (10), (3) or Tatebatake 2017 (10); the basic model has none, its (18).
    """
    if variant == BASIC:
        return 0.0, 0.0, y
    if variant == 0.0:
        return y1, y2, y
    if variant == 1.0:
        # with a harmonic, V1 regresses on y1 = y - y3, Fujii 2018 (6); y3 is zero otherwise
        return y2 - z2, y3 - z3, y - y1
    return y2, y1, y - y1


@jit
def update_many(
    u: FloatArray,
    y: FloatArray,
    errors: FloatArray,
    scale: float,
    theta: FloatArray,
    p: FloatArray,
    x: FloatArray,
    g: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    """Update with samples; y and errors are in metres, with `scale` working units per metre.

    The memory is in local variables during the loop, which is four times faster.
    """
    k0, y1, y2, y3, u1, h, su, sv, sb, sg, z1, z2, z3, ee, ww = m
    variant, offset, harmonic, omega, forgetting, phase = c
    n = theta.size
    last = n - 4
    # Tatebatake 2017 has +S(du), +S|du| and -A0|du| where Fujii 2018 has the opposite
    sign = 1.0 if variant == 2.0 else -1.0
    for k in range(u.size):
        voltage, value = u[k], y[k] * scale
        if not (isfinite(voltage) and isfinite(value)):
            errors[k] = nan  # a lost sample is skipped: a NaN in P would persist
            continue
        du = voltage - u1
        travel, size = abs(du), abs(h)
        su, sv, sb, sg = su + du, sv + travel, sb + travel * h, sg + size * du
        x[0], x[1], error = _lags(value, y1, y2, y3, z2, z3, variant)
        x[2], x[3], x[4], x[5], x[6] = voltage, sign * su, sign * sv, sb, sg
        if variant == BASIC:  # a column of zeros leaves its parameter at the initial value 0
            x[4] = 0.0
        if offset == 1.0:
            x[7] = 1.0
        if harmonic > 0.0:
            x[last], x[last + 1] = z2, z3
            x[last + 2], x[last + 3] = sin(phase + omega * k0), cos(phase + omega * k0)
        for i in range(n):
            error -= theta[i] * x[i]
        _gain(x, theta, p, g, error, forgetting)
        h += (
            theta[3] * du - sign * theta[4] * travel - theta[6] * size * du - theta[5] * travel * h
        )
        if harmonic > 0.0:
            z = z1
            for i in range(last, n):
                z += theta[i] * x[i]
            z1, z2, z3 = z, z1, z2
        y1, y2, y3, u1, k0 = value, y1, y2, voltage, k0 + 1.0
        ee, ww = forgetting * ee + error * error, forgetting * ww + 1.0
        errors[k] = error / scale
    kept = (k0, y1, y2, y3, u1, h, su, sv, sb, sg, z1, z2, z3, ee, ww)
    for i in range(len(kept)):
        m[i] = kept[i]


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
        # y is the recursion without the harmonic (V1, V2: y1 of Fujii 2018 (6)), z the harmonic.
        if c[_VARIANT] == 0.0:
            value = theta[0] * y1 + theta[1] * y2 + v
        elif c[_VARIANT] == BASIC:
            value = v
        else:
            value = y1 + theta[0] * y2 + theta[1] * y3 + v
        y3, y2, y1, u1 = y2, y1, value, u[k]
        y[k] = value
        if c[_HARMONIC] > 0.0:
            phase = c[PHASE] + c[OMEGA] * k
            drive = theta[last + 2] * sin(phase) + theta[last + 3] * cos(phase)
            z = z1 + theta[last] * z2 + theta[last + 1] * z3 + drive
            if c[_VARIANT] == 0.0:
                # V0 adds the harmonic inside the recursion of the total y.
                y[k] += theta[last] * z2 + theta[last + 1] * z3 + drive
                y1 = y[k]
            else:
                y[k] += z
            z3, z2, z1 = z2, z1, z
