"""Continuous-time inverse of a mode with the analytic derivatives of the reference.

The zero-order-hold model of a mode has a zero near z = -1, whose inverse oscillates at the Nyquist
frequency. The continuous form has none: ``w = d + k1 d' + k2 d''``, evaluated half a sample ahead,
in the middle of the hold interval.
"""

from __future__ import annotations

import math

from piezo_hysteresis.arrays import FloatArray
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
