"""Kernels of the modal model: modes driven by all axes, hysteresis of the elongation fed back.

Mode ``k`` has the coordinate ``q`` and the rate ``d``, both in volts of its drive, exactly
discretised for a drive that is linear within a tick. The elongation of axis ``i`` is the sum of
all coordinates, weighted with the input shapes (reciprocity); its plays act as a voltage.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._plays import play
from piezo_hysteresis.jit import jit, jit_sums


@jit
def play_bank(x: FloatArray, widths: FloatArray, out: FloatArray, turns: int) -> None:
    """Follow plays of half width `widths` from rest, (n,) to (n, plays); the last turn counts."""
    state = np.zeros(widths.size)
    for _ in range(turns):
        for n in range(x.size):
            for j in range(widths.size):
                state[j] = play(x[n], state[j], widths[j])
                out[n, j] = state[j]


def discretised(omega: FloatArray, damping: FloatArray, dt: float) -> FloatArray:
    """Return the exact steps of all modes."""
    # omega [rad/s] (...); damping (...); dt [s] -> (..., 12)
    m = np.zeros((*omega.shape, 6, 6))
    m[..., 0, 1] = m[..., 1, 2] = m[..., 0, 3] = omega
    m[..., 1, 0], m[..., 1, 1] = -omega, -2.0 * damping * omega
    m[..., 2, 4] = m[..., 3, 5] = 1.0 / dt
    x = expm(m * dt)
    rows = [
        (x[..., i, 0], x[..., i, 1], x[..., i, 2] - x[..., i, 4], x[..., i, 4],
         x[..., i, 3] - x[..., i, 5], x[..., i, 5])
        for i in (0, 1)
    ]  # fmt: skip
    return np.ascontiguousarray(np.stack([*rows[0], *rows[1]], -1))


@jit_sums
def follow(
    drive: FloatArray,  # [V] (n, axes)
    steps: FloatArray,  # (blocks, 12, modes)
    block: int,
    omega: FloatArray,  # [rad/s] (blocks, modes)
    shape: FloatArray,  # (axes, modes)
    rate_shape: FloatArray,  # (axes, modes)
    weights: FloatArray,  # (plays, axes)
    widths: FloatArray,  # [V] (plays,)
    square: FloatArray,  # [1/V] (axes,)
    cube: FloatArray,  # [1/V^2] (axes,)
    settle: int,
    every: int,
    state: FloatArray,  # (2 modes + axes + plays axes,)
    q_out: FloatArray,  # [V] (n / every, modes)
    d_out: FloatArray,  # [V/s] (n / every, modes)
    w_out: FloatArray,  # [V] (n / every, axes)
    e_out: FloatArray,  # [V] (n / every, axes)
) -> None:
    """Follow all modes over `settle` ticks of the end of the drive, then over the whole drive."""
    ticks, axes = drive.shape
    modes, plays = shape.shape[1], widths.size
    q, d = state[:modes], state[modes : 2 * modes]
    w = state[2 * modes : 2 * modes + axes]
    p = state[2 * modes + axes :].reshape((plays, axes))
    g0, h0, g, h = np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(modes)
    e, dw = np.zeros(axes), np.zeros(axes)
    before = (ticks - settle - 1) % ticks
    if settle > 0:
        for i in range(axes):
            v = drive[before, i] + w[i]
            for k in range(modes):
                g0[k] += shape[i, k] * v
                h0[k] += rate_shape[i, k] * v
    for n in range(ticks - settle, 2 * ticks):
        t = n % ticks
        a = steps[t // block]
        g[:] = 0.0
        h[:] = 0.0
        for i in range(axes):  # predictor: the feedback of the tick before
            v = drive[t, i] + w[i]
            for k in range(modes):
                g[k] += shape[i, k] * v
                h[k] += rate_shape[i, k] * v
        for k in range(modes):
            x = (a[0, k] * q[k] + a[1, k] * d[k] + a[2, k] * g0[k] + a[3, k] * g[k]
                 + a[4, k] * h0[k] + a[5, k] * h[k])  # fmt: skip
            d[k] = (a[6, k] * q[k] + a[7, k] * d[k] + a[8, k] * g0[k] + a[9, k] * g[k]
                    + a[10, k] * h0[k] + a[11, k] * h[k])  # fmt: skip
            q[k] = x
        for i in range(axes):
            total = 0.0
            for k in range(modes):
                total += shape[i, k] * q[k]
            e[i] = total
            fed = square[i] * total * total + cube[i] * total * total * total
            for j in range(plays):
                p[j, i] = play(total, p[j, i], widths[j])
                fed += weights[j, i] * p[j, i]
            dw[i], w[i] = fed - w[i], fed
        for i in range(axes):  # corrector: its change over the tick
            for k in range(modes):
                more, faster = shape[i, k] * dw[i], rate_shape[i, k] * dw[i]
                q[k] += a[3, k] * more + a[5, k] * faster
                d[k] += a[9, k] * more + a[11, k] * faster
                g[k] += more
                h[k] += faster
        for k in range(modes):
            g0[k], h0[k] = g[k], h[k]
        if n >= ticks and t % every == 0:
            out = t // every
            for k in range(modes):
                q_out[out, k] = q[k]
                d_out[out, k] = omega[t // block, k] * (d[k] + h[k])
            for i in range(axes):
                w_out[out, i], e_out[out, i] = w[i], e[i]
