"""Exact gradient of a modal model in free run, followed backwards in time.

`modal_fit.ModalDerivatives` takes plays and powers of the elongation as gains. That is near enough
for the curvature of a fit, not for its slope: the fit then ends before the hysteresis acts.
"""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.modal_model import (
    OVERSAMPLING,
    RATE_UNIT,
    AxesDrive,
    ModalModel,
    discretised,
    play_bank,
)
from piezo_hysteresis.jit import jit_sums

_STEP = 1e-5  # of the logarithms of frequency and damping


@jit_sums
def follow_back(
    drive: FloatArray,  # [V] (n, axes)
    a: FloatArray,  # (12, modes)
    omega: FloatArray,  # [rad/s] (modes,)
    shape: FloatArray,  # (axes, modes)
    rate_shape: FloatArray,  # (axes, modes)
    weights: FloatArray,  # (plays, axes)
    square: FloatArray,  # [1/V] (axes,)
    cube: FloatArray,  # [1/V^2] (axes,)
    q: FloatArray,  # [V] (n, modes)
    d: FloatArray,  # [V] (n, modes)
    w: FloatArray,  # [V] (n, axes)
    e: FloatArray,  # [V] (n, axes)
    p: FloatArray,  # [V] (n, plays, axes)
    every: int,
    of_q: FloatArray,  # slope of the cost by what `modal_model.follow` writes, (n / every, modes)
    of_d: FloatArray,
    of_w: FloatArray,  # (n / every, axes)
    of_e: FloatArray,
    of_a: FloatArray,  # slopes of the cost by arguments, in their shapes
    of_omega: FloatArray,
    of_shape: FloatArray,
    of_rate: FloatArray,
    of_weights: FloatArray,
    of_square: FloatArray,
    of_cube: FloatArray,
    of_drive: FloatArray,
) -> None:
    """Follow a period twice from its end, as `modal_model.follow` backwards; the second counts."""
    ticks, axes = drive.shape
    modes, plays = shape.shape[1], weights.shape[0]
    qb, db, gb, hb = np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(modes)
    wb, pb, wn = np.zeros(axes), np.zeros((plays, axes)), np.zeros(axes)
    g, h, g0, h0 = np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(modes)
    more, faster, x = np.zeros(modes), np.zeros(modes), np.zeros(modes)
    gm, hm = np.zeros(modes), np.zeros(modes)
    for n in range(2 * ticks - 1, -1, -1):
        t, s = n % ticks, (n - 1) % ticks
        if n == ticks - 1:
            of_a[:], of_omega[:], of_shape[:], of_rate[:] = 0.0, 0.0, 0.0, 0.0
            of_weights[:], of_square[:], of_cube[:], of_drive[:] = 0.0, 0.0, 0.0, 0.0
        g[:], h[:], g0[:], h0[:], more[:], faster[:] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(axes):
            v, v0, dw = drive[t, i] + w[s, i], drive[s, i] + w[s, i], w[t, i] - w[s, i]
            for k in range(modes):
                g[k] += shape[i, k] * v
                h[k] += rate_shape[i, k] * v
                g0[k] += shape[i, k] * v0
                h0[k] += rate_shape[i, k] * v0
                more[k] += shape[i, k] * dw
                faster[k] += rate_shape[i, k] * dw
        read, out = t % every == 0, t // every
        if read:
            for k in range(modes):
                qb[k] += of_q[out, k]
                db[k] += omega[k] * of_d[out, k]
                hb[k] += omega[k] * of_d[out, k]
                of_omega[k] += (d[t, k] + h[k] + faster[k]) * of_d[out, k]
            for i in range(axes):
                wb[i] += of_w[out, i]
                of_drive[t, i] += of_w[out, i]
        for k in range(modes):  # corrector
            gm[k] = a[3, k] * qb[k] + a[9, k] * db[k] + gb[k]
            hm[k] = a[5, k] * qb[k] + a[11, k] * db[k] + hb[k]
            of_a[3, k] += more[k] * qb[k]
            of_a[9, k] += more[k] * db[k]
            of_a[5, k] += faster[k] * qb[k]
            of_a[11, k] += faster[k] * db[k]
            x[k] = q[t, k] - a[3, k] * more[k] - a[5, k] * faster[k]
        for i in range(axes):
            dw, change, y = w[t, i] - w[s, i], 0.0, e[t, i]
            for k in range(modes):
                change += shape[i, k] * gm[k] + rate_shape[i, k] * hm[k]
                of_shape[i, k] += gm[k] * dw
                of_rate[i, k] += hm[k] * dw
            fed, wn[i] = change + wb[i], -change
            of_square[i] += fed * y * y
            of_cube[i] += fed * y * y * y
            total = fed * (2.0 * square[i] * y + 3.0 * cube[i] * y * y)
            if read:
                total += of_e[out, i]
            for j in range(plays):
                of_weights[j, i] += fed * p[t, j, i]
                pb[j, i] += fed * weights[j, i]
                if p[t, j, i] != p[s, j, i]:  # it moves with the elongation
                    total += pb[j, i]
                    pb[j, i] = 0.0
            for k in range(modes):
                qb[k] += shape[i, k] * total
                of_shape[i, k] += total * x[k]
        for k in range(modes):  # predictor
            u, r = qb[k], db[k]
            of_a[0, k] += q[s, k] * u
            of_a[1, k] += d[s, k] * u
            of_a[2, k] += g0[k] * u
            of_a[3, k] += g[k] * u
            of_a[4, k] += h0[k] * u
            of_a[5, k] += h[k] * u
            of_a[6, k] += q[s, k] * r
            of_a[7, k] += d[s, k] * r
            of_a[8, k] += g0[k] * r
            of_a[9, k] += g[k] * r
            of_a[10, k] += h0[k] * r
            of_a[11, k] += h[k] * r
            gm[k] = gb[k] + a[3, k] * u + a[9, k] * r
            hm[k] = hb[k] + a[5, k] * u + a[11, k] * r
            qb[k], db[k] = a[0, k] * u + a[6, k] * r, a[1, k] * u + a[7, k] * r
            gb[k], hb[k] = a[2, k] * u + a[8, k] * r, a[4, k] * u + a[10, k] * r
        for i in range(axes):
            v, change = drive[t, i] + w[s, i], 0.0
            for k in range(modes):
                change += shape[i, k] * gm[k] + rate_shape[i, k] * hm[k]
                of_shape[i, k] += gm[k] * v
                of_rate[i, k] += hm[k] * v
            of_drive[t, i] += change
            wb[i] = wn[i] + change


def gradient(model: ModalModel, drive: AxesDrive, by_signals: FloatArray) -> FloatArray:
    """Return the slope of a cost by all parameters but the delay, shape (layout.size,).

    `by_signals`, shape (n, features), is its slope by the signals of the drive, a period.
    """
    layout, found, parts = model.layout, model.parameters, model.layout.parts
    places = np.cumsum([layout.modes, layout.modes, parts])
    of_q, of_d, of_w, rest = np.split(by_signals, places, axis=1)
    forced, a, q, d, w, e = model.followed(drive, 1)
    omega, damping = (each[0] for each in model.modes_at(drive.level))
    widths = np.asarray(layout.elongation_plays)
    p = np.empty((e.shape[0], widths.size, parts))
    for i in range(parts):
        play_bank(np.ascontiguousarray(e[:, i]), widths, p[:, :, i], 2)
    of_e, read = np.zeros((of_q.shape[0], parts)), e[::OVERSAMPLING]
    if layout.products:
        pairs = [(i, j) for i in range(parts) for j in range(i + 1)]
        for column, (i, j) in zip(rest.T, pairs, strict=False):
            of_e[:, i] += column * read[:, j]
            of_e[:, j] += column * read[:, i]
    slope = np.zeros(layout.size)
    of = layout.named(slope)
    of_a, of_omega, of_drive = np.zeros_like(a[0]), np.zeros(layout.modes), np.zeros_like(forced)
    follow_back(
        forced, a[0], omega, found['shape'], found['rate_shape'], found['elongation_weights'],
        found['square'], found['cube'], q, d / omega - (forced + w) @ found['rate_shape'], w, e, p,
        OVERSAMPLING, np.ascontiguousarray(of_q), of_d * RATE_UNIT, np.ascontiguousarray(of_w),
        of_e,
        of_a, of_omega, of['shape'], of['rate_shape'], of['elongation_weights'], of['square'],
        of['cube'], of_drive,
    )  # fmt: skip
    of['voltage_weights'][...] = np.einsum(
        'jti,ti->ji', drive.memory, of_drive[:, : layout.inputs]
    )
    more, less, dt = 1.0 + _STEP, 1.0 - _STEP, model.dt / OVERSAMPLING
    by_omega = discretised(more * omega, damping, dt) - discretised(less * omega, damping, dt)
    by_damping = discretised(omega, more * damping, dt) - discretised(omega, less * damping, dt)
    still, (grown, slopes) = np.exp(found['log_omega']), model.grown(drive.level)
    of_omega += np.sum(of_a * by_omega.T, 0) / (2.0 * _STEP * omega)
    of['log_omega'][:] = of_omega * omega
    of['log_damping'][:] = np.sum(of_a * by_damping.T, 0) / (2.0 * _STEP)
    of['softening'][...] = -grown.T * still * of_omega
    of['level_damping'][...] = grown.T * of['log_damping']
    change = slopes @ found['level_damping'] * of['log_damping']
    of['level_power'][0] = np.sum(change - slopes @ found['softening'] * still * of_omega)
    return slope
