"""The quintic smooth step: value, velocity and acceleration are continuous at both ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import inline_jit, jit

# A shorter rise [s] is a step: the square of its length must not vanish.
_SHORTEST = 1e-9

#: Its steepest slope, of unit height and length.
STEEPEST = 1.875


def _quintic(s: Any) -> tuple[Any, Any, Any]:
    """Return the polynomial and its first two derivatives, of a number or an array."""
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


quintic = jit(_quintic)


@inline_jit
def smooth_step(s: float) -> tuple[float, float, float]:
    """Return the smooth step at `s` in 0..1 and its first two derivatives."""
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    value, slope, bend = quintic(s)
    return value, slope, bend


def smooth_ramp(time: FloatArray, length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a rise from 0 to 1 over `length` seconds, with its first two derivatives.

    It hardly excites a lightly damped mode.
    """
    if length <= _SHORTEST:
        return np.ones_like(time), np.zeros_like(time), np.zeros_like(time)
    value, slope, bend = _quintic(np.clip(time / length, 0.0, 1.0))
    return value, slope / length, bend / length**2
