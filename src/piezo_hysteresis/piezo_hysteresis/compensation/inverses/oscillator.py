"""Feedforward for an oscillator with a hysteretic restoring force: displacement in, force out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, take
from piezo_hysteresis.compensation.inverses.structure_inverse import STATE_SIZE, invert_structure
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit, leaf, scratch

_NAMES = ('mass', 'damping', 'stiffness', 'z_alpha', 'z_beta', 'z_gamma', 'z_exponent')
_CLAMPED, _STROKE, _X, _Z, _OWN = range(5)


@leaf
def _add_restoring_force(
    x: FloatArray, force: FloatArray, memory: FloatArray, p: FloatArray, low: float, high: float
) -> None:
    """Add z(x) to `force`; the decay of z is frozen over a step for exponents other than 1."""
    scale = abs(p[4]) + abs(p[5])
    height = abs(p[3]) / scale if scale > 0.0 else 0.0
    for k in range(x.size):
        z = memory[_Z]
        bend = 1.0
        if p[6] != 1.0 and height > 0.0:
            bend = max(abs(z) / height, 1e-9) ** (p[6] - 1.0)
        z = exact_step(z, x[k] - memory[_X], p[3], 0.0, p[4] * bend, p[5] * bend)
        memory[_X], memory[_Z] = x[k], z
        total = p[2] * force[k] + z
        if total > high or total < low:
            total = min(max(total, low), high)
            memory[_STROKE] += 1.0
        force[k] = total


@jit
def invert_oscillator(
    reference: FloatArray,
    voltage: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
    low: float,
    high: float,
) -> None:
    """Return the force that moves the oscillator along the reference, sample by sample."""
    own, x = _OWN + STATE_SIZE, scratch(1)
    k1, k2 = p[1] / p[2], p[0] / p[2]
    for k in range(voltage.size):
        row, force = reference[:, k : k + 1], voltage[k : k + 1]
        invert_structure(row, x, memory[_OWN:own], 0.0, 0.0, p[7], dt)
        invert_structure(row, force, memory[own:], k1, k2, p[7], dt)
        _add_restoring_force(x, force, memory, p, low, high)


class OscillatorInverse(InverseLink):
    """Feedforward for ``m x'' + c x' + k x + z = F`` with z a Bouc-Wen force of x.

    The input of the hysteresis is the displacement, so the inverse evaluates the model directly
    and solves no equation.
    """

    memory_size = _OWN + 2 * STATE_SIZE
    run = staticmethod(invert_oscillator)

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        packed = take({'z_exponent': 1.0, **parameters}, _NAMES, 'the inverse of the oscillator')
        if not (packed[0] > 0 and packed[2] > 0 and packed[2] + packed[3] > 0):
            raise CompensationError('mass, stiffness and stiffness + z_alpha must be positive')
        held = parameters.get('interpolation', 2.0) == 0.0
        return np.array([*packed, 0.5 * self.dt if held else 0.0])
