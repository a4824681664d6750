"""Exact zero-order hold of one second-order system of unit DC gain."""

from math import cos, cosh, exp, sin, sinh, sqrt
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import InterSample, System
from piezo_hysteresis.jit import jit


def mode_system(omega: float, damping_ratio: float) -> System:
    """Return ``x'' + 2 zeta w x' + w^2 x = w^2 v`` with states (position, velocity)."""
    square = omega * omega
    return System(
        np.array([[0.0, 1.0], [-square, -2.0 * damping_ratio * omega]]),
        np.array([0.0, square]),
        np.array([1.0, 0.0]),
        0.0,
    )


@jit
def hold(omega: float, damping_ratio: float, dt: float) -> tuple[float, float, float, float]:
    """Return the transition (a11, a12, a21, a22) of ``x'' + 2 zeta w x' + w^2 x = w^2 v``.

    The input matrix is ``(1 - a11, -a21)``, because the DC gain is 1. Holds for under-,
    over- and critically damped systems alike.
    """
    s = damping_ratio * omega
    d = omega * omega * (damping_ratio * damping_ratio - 1.0)
    z = d * dt * dt
    if abs(z) < 1e-4:
        e = exp(-s * dt)
        c = e * (1.0 + z * (1.0 / 2.0 + z * (1.0 / 24.0 + z / 720.0)))
        w = e * dt * (1.0 + z * (1.0 / 6.0 + z * (1.0 / 120.0 + z / 5040.0)))
    elif z < 0.0:
        root = sqrt(-d)
        e = exp(-s * dt)
        c = e * cos(root * dt)
        w = e * sin(root * dt) / root
    elif z < 1.0:
        root = sqrt(d)
        e = exp(-s * dt)
        c = e * cosh(root * dt)
        w = e * sinh(root * dt) / root
    else:
        # exponents combined before they overflow; s - root without cancellation
        root = sqrt(d)
        slow = exp(-omega * omega / (s + root) * dt)
        fast = exp(-(s + root) * dt)
        c = 0.5 * (slow + fast)
        w = 0.5 * (slow - fast) / root
    return c + s * w, w, -omega * omega * w, c - s * w


def series_mode(law: Any) -> dict[str, Any]:
    """Return kernel and system of a mode; ``law(p)`` is omega [rad/s] and the damping ratio."""

    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Return the position; state is (position [m], velocity [m/s]) at the next sample."""
        omega, ratio = law(p)
        a11, a12, a21, a22 = hold(omega, ratio, dt)
        b1, b2 = 1.0 - a11, -a21
        position, velocity = state[0], state[1]
        for k in range(x.size):
            # sampled before the new hold acts: y[k] depends on the inputs up to k - 1
            y[k] = position
            moved = a11 * position + a12 * velocity + b1 * x[k]
            velocity = a21 * position + a22 * velocity + b2 * x[k]
            position = moved
        state[0] = position
        state[1] = velocity

    def system(p: FloatArray) -> System:
        return mode_system(*law(p))

    return {'kernel': kernel, 'system': system, 'between': InterSample.LINEAR}
