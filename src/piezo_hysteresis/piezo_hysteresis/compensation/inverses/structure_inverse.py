"""Continuous-time inverse of a mode with the analytic derivatives of the reference.

The zero-order-hold model of a mode has a zero near z = -1, whose inverse oscillates at the Nyquist
frequency. The continuous form has none: ``w = d + k1 d' + k2 d''``, evaluated half a sample ahead,
in the middle of the hold interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, take
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit, leaf, scratch

# Indices in the state; the number of corners is first.
CORNERS, _SEEN, _D, _V, _A, _SMOOTH, _W1, _W2 = range(8)
STATE_SIZE = 8

# Relative deviation from the integrated acceleration up to which a change of velocity is smooth.
_TOLERANCE = 0.25


@leaf
def carry_ahead(
    reference: FloatArray, ahead: FloatArray, state: FloatArray, lead: float, dt: float
) -> None:
    """Extrapolate the reference by `lead` seconds into `ahead`.

    Rows of both are displacement, velocity and acceleration. The polynomial of fifth degree
    through the last two ticks is extrapolated; after a corner, which is counted, only the
    derivatives at the tick are used. Displacement and derivatives must be consistent: the
    polynomial amplifies an error of a derivative of a thousandth.
    """
    for k in range(reference.shape[1]):
        d, v, a = reference[0, k], reference[1, k], reference[2, k]
        jerk = snap = crackle = 0.0
        if state[_SEEN] > 0.0:
            d0, v0, a0 = state[_D], state[_V], state[_A]
            miss = abs(v - v0 - 0.5 * dt * (a + a0))
            if miss > _TOLERANCE * dt * max(abs(a), abs(a0)) + 1e-9 * (abs(v) + abs(v0)):
                # The first ticks of a reference from rest are not a corner.
                if state[_SEEN] > 2.0:
                    state[CORNERS] += 1.0
                state[_SEEN] = state[_SMOOTH] = 0.0
            else:
                r0 = d0 - d + v * dt - 0.5 * a * dt * dt
                r1 = (v0 - v + a * dt) * dt
                r2 = (a0 - a) * dt * dt
                jerk = -(60.0 * r0 + 24.0 * r1 + 3.0 * r2) / dt**3
                snap = -(360.0 * r0 + 168.0 * r1 + 24.0 * r2) / dt**4
                crackle = -(720.0 * r0 + 360.0 * r1 + 60.0 * r2) / dt**5
        state[_D], state[_V], state[_A] = d, v, a
        state[_SEEN] += 1.0
        t = lead
        here = d + t * (v + t * (a / 2.0 + t * (jerk / 6.0 + t * (snap / 24.0))))
        ahead[0, k] = here + t**5 * crackle / 120.0
        ahead[1, k] = v + t * (a + t * (jerk / 2.0 + t * (snap / 6.0 + t * crackle / 24.0)))
        ahead[2, k] = a + t * (jerk + t * (snap / 2.0 + t * crackle / 6.0))


@leaf
def lift_droop(target: FloatArray, state: FloatArray) -> None:
    """Compensate the droop of the hold, ``(w dt)^2 / 24``, if the target has been smooth."""
    for k in range(target.size):
        w = target[k]
        if state[_SMOOTH] >= 3.0:
            target[k] = w - (w - 2.0 * state[_W1] + state[_W2]) / 24.0
        state[_W2], state[_W1] = state[_W1], w
        state[_SMOOTH] += 1.0


@leaf
def invert_structure(
    reference: FloatArray,
    target: FloatArray,
    state: FloatArray,
    k1: float,
    k2: float,
    lead: float,
    dt: float,
) -> None:
    """Return the quasi-static displacement [m] that moves the structure along the reference.

    The reference, with rows displacement, velocity and acceleration, is extrapolated by `lead`
    seconds; with a lead, the droop of the hold is compensated, too.
    """
    ahead = scratch((3, 1))
    for k in range(target.size):
        carry_ahead(reference[:, k : k + 1], ahead, state, lead, dt)
        target[k] = ahead[0, 0] + k1 * ahead[1, 0] + k2 * ahead[2, 0]
        if lead > 0.0:
            lift_droop(target[k : k + 1], state)


@jit
def mode_coefficients(natural_frequency: float, damping_ratio: float) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``w = d + k1 d' + k2 d''`` for one mode of unit DC gain."""
    omega = 2.0 * math.pi * natural_frequency
    return 2.0 * damping_ratio / omega, 1.0 / (omega * omega)


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
