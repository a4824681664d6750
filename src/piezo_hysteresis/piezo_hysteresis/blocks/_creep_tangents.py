"""Compiled sensitivities of creep: elements are linear, and so are all their derivatives."""

from __future__ import annotations

from math import exp, expm1

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._creep_times import ELEMENTS, PER_DECADE, SPECTRUM, over_onset
from piezo_hysteresis.jit import jit


@jit
def _element(
    x: FloatArray,
    y: FloatArray,
    dx: FloatArray,
    dy: FloatArray,
    share: float,
    tau: float,
    by_share: FloatArray,
    by_tau: FloatArray,
    dt: float,
) -> None:
    """Add one element to `y` and to its derivatives, of which those of `dx` come first.

    `by_share` and `by_tau` say how share and time constant change with each own parameter.
    """
    m = dx.shape[0]
    rest = -expm1(-dt / tau)
    slope = -exp(-dt / tau) * dt / (tau * tau)  # of `rest` with tau
    unit = np.empty(x.size)
    aged = np.empty(x.size)
    c = d = 0.0
    for k in range(x.size):
        d += slope * (x[k] - c) - rest * d
        c += rest * (x[k] - c)
        unit[k] = c
        aged[k] = d
        y[k] += share * c
    for j in range(by_share.size):
        if by_share[j] != 0.0 or by_tau[j] != 0.0:
            one, two = by_share[j], share * by_tau[j]
            for k in range(x.size):
                dy[m + j, k] += one * unit[k] + two * aged[k]
    for first in range(0, m, 4):
        # side by side: one recursion waits for its own last value most of the time
        count = min(4, m - first)
        i, j = first, first + min(1, count - 1)
        s, t = first + min(2, count - 1), first + min(3, count - 1)
        c0 = c1 = c2 = c3 = 0.0
        for k in range(x.size):
            c0 += rest * (dx[i, k] - c0)
            c1 += rest * (dx[j, k] - c1)
            c2 += rest * (dx[s, k] - c2)
            c3 += rest * (dx[t, k] - c3)
            dy[i, k] += share * c0
            if count > 1:
                dy[j, k] += share * c1
            if count > 2:
                dy[s, k] += share * c2
            if count > 3:
                dy[t, k] += share * c3


@jit
def _begin(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray
) -> tuple[FloatArray, FloatArray]:
    m = dx.shape[0]
    y[:] = x
    dy[:m] = dx
    dy[m:] = 0.0
    return np.zeros(p.size), np.zeros(p.size)


@jit
def creep(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """One element: share and time constant."""
    by_share, by_tau = _begin(x, y, dx, dy, p)
    by_share[0] = 1.0
    by_tau[1] = 1.0
    _element(x, y, dx, dy, p[0], p[1], by_share, by_tau, dt)


@jit
def creep_pair(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Two elements, the time constant of the second as a multiple of that of the first."""
    by_share, by_tau = _begin(x, y, dx, dy, p)
    by_share[0] = 1.0
    by_tau[1] = 1.0
    _element(x, y, dx, dy, p[0], p[1], by_share, by_tau, dt)
    by_share[0] = 0.0
    by_share[2] = 1.0
    by_tau[1] = p[3]
    by_tau[3] = p[1]
    _element(x, y, dx, dy, p[2], p[1] * p[3], by_share, by_tau, dt)


@jit
def creep_spectrum(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Elements of known time constants: each share has a row of its own."""
    by_share, by_tau = _begin(x, y, dx, dy, p)
    for i in range(p.size):
        by_share[:] = 0.0
        by_share[i] = 1.0
        _element(x, y, dx, dy, p[i], SPECTRUM[i], by_share, by_tau, dt)


@jit
def logarithmic_creep(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Bank of elements that moves with its onset."""
    by_share, by_tau = _begin(x, y, dx, dy, p)
    by_share[0] = 1.0 / PER_DECADE
    for i in range(ELEMENTS):
        by_tau[1] = over_onset(i)
        _element(x, y, dx, dy, p[0] / PER_DECADE, p[1] * by_tau[1], by_share, by_tau, dt)
