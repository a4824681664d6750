"""Compiled sensitivities of a mode that is not linear: the step of each tick is differenced.

Position, velocity and bristles are three numbers. So the derivatives of one tick by them, by the
input and by the block's own parameters are a dozen short runs, whatever is carried along from
upstream, where differences of whole records take one run for each.
"""

from __future__ import annotations

from math import pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._rubbing import kernel
from piezo_hysteresis.jit import jit

_STEP = 1e-6  # of a difference, in units of what is usual; sqrt of the rounding, times some
_STATES = 3
_OWN = 7


@jit
def _steps_of(x: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much states and input, then own parameters, are moved for a difference."""
    span = 1e-300
    for k in range(x.size):
        span = max(span, abs(x[k]))
    moved = np.empty(_STATES + 1)
    moved[0] = moved[3] = _STEP * span
    moved[1] = _STEP * span * 2.0 * pi * p[0]
    moved[2] = _STEP
    own = np.empty(_OWN)
    for j in range(_OWN):
        own[j] = _STEP * abs(p[j])
    if p[2] == 0.0:
        own[2] = _STEP / (span * span)
    if p[3] == 0.0:
        own[3] = _STEP * span
    return moved, own


@jit
def nonlinear_mode(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return what the block does; a tick is differentiated through its own differences."""
    m = dx.shape[0]
    moved, own = _steps_of(x, p)
    others = np.empty((_OWN, _OWN))
    for j in range(_OWN):
        others[j] = p
        others[j, j] += own[j]
    state, tried = np.zeros(_STATES), np.empty(_STATES)
    by = np.empty((_STATES, _STATES + 1))
    forcing = np.empty((_STATES, _OWN))
    rows = np.zeros((m + _OWN, _STATES))
    held, answer = np.empty(1), np.empty(1)
    for k in range(x.size):
        y[k] = state[0]
        for j in range(m + _OWN):
            dy[j, k] = rows[j, 0]
        before = state.copy()
        held[0] = x[k]
        kernel(held, answer, state, p, dt, 0.0)
        for j in range(_STATES + 1):
            tried[:] = before
            if j < _STATES:
                tried[j] += moved[j]
            else:
                held[0] = x[k] + moved[j]
            kernel(held, answer, tried, p, dt, 0.0)
            held[0] = x[k]
            for i in range(_STATES):
                by[i, j] = (tried[i] - state[i]) / moved[j]
        for j in range(_OWN):
            tried[:] = before
            kernel(held, answer, tried, others[j], dt, 0.0)
            for i in range(_STATES):
                forcing[i, j] = (tried[i] - state[i]) / own[j] if own[j] > 0.0 else 0.0
        for j in range(m + _OWN):
            a, b, c = rows[j, 0], rows[j, 1], rows[j, 2]
            for i in range(_STATES):
                value = by[i, 0] * a + by[i, 1] * b + by[i, 2] * c
                value += by[i, 3] * dx[j, k] if j < m else forcing[i, j - m]
                rows[j, i] = value
