"""Common parts of the Bouc-Wen blocks: parameters in the order of the kernel, and its loop.

Blocks of the same hysteresis (Euler step, exact step, with exponent, ...) use the same names for
the same quantities, so that one can replace another with the same values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Kernel, Parameter
from piezo_hysteresis.jit import jit

LINEAR_GAIN = Parameter(
    'A1',
    'm/V',
    1.5e-4,
    -1e-2,
    1e-2,
    'Linear gain from voltage to displacement before the hysteretic share h is subtracted.',
    1e-4,
)
PARAMETERS = (
    LINEAR_GAIN,
    Parameter(
        'A',
        'm/V',
        4e-5,
        -1e-2,
        1e-2,
        'Growth of the hysteretic share h with the travel of the voltage.',
        5e-5,
    ),
    Parameter(
        'A0',
        'm/V',
        0.0,
        -1e-2,
        1e-2,
        'Asymmetry: growth of h with the length of the travel, moves the loop off centre.',
        1e-5,
    ),
    Parameter(
        'beta',
        '1/V',
        1.0,
        0.0,
        1e4,
        'Decay of h with the length of the travel; 1/(beta + gamma) is the memory in volts.',
        1.0,
    ),
    Parameter(
        'gamma',
        '1/V',
        0.1,
        -1e4,
        1e4,
        'Difference of the decay of h between loading and unloading, sets the shape of the tips.',
        1.0,
    ),
)


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why h is unbounded for these values."""
    if values['beta'] == 0.0 and values['A0'] != 0.0:
        return 'A0 without decay (beta = 0) grows without bound; set beta above 0 or A0 to 0'
    return ''


def run_of(step: Any) -> Kernel:
    """Return the kernel for ``step(h, du, A, A0, beta, gamma)``, which returns h after a move."""

    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Return ``A1 u - h``; state is (last voltage [V], h [m])."""
        a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
        last, h = state[0], state[1]
        for k in range(x.size):
            h = step(h, x[k] - last, a, a0, beta, gamma)
            last = x[k]
            y[k] = a1 * last - h
        state[0] = last
        state[1] = h

    return kernel
