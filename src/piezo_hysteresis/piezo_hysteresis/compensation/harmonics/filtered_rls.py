"""Harmonic cancellation by recursive least squares on the filtered reference (FxRLS).

Sines whose complex amplitude follows the error through the modelled plant gain. The fastest
method, with the largest attenuation, if the model is accurate. It cannot detect a phase error of
the gain above 90 degrees, and then diverges to its bound. A suitable forgetting factor is 0.998 at
1 kHz.
"""

from __future__ import annotations

import cmath
import math

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.attenuation_settings import (
    FORGETTING,
    LARGEST,
    ORDERS,
)
from piezo_hysteresis.compensation.harmonics.harmonic_rls import rls_update
from piezo_hysteresis.compensation.harmonics.lines import Harmonic, folded
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.jit import jit, leaf, scratch

# Places in the memory: frequency, what was counted, then of each order two numbers of the
# correction [V], the gain [m/V], the error [m] and the share; the covariance comes last.
_FREQUENCY, BOUNDED, _THETA = range(3)


@jit
def filtered_size(p: FloatArray) -> int:
    """Return the size of the memory for packed settings."""
    m = 2 * (p.size - ORDERS)
    return _THETA + 4 * m + m * m


@jit
def clear(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Reset every correction; the covariance starts at its steady state for unit sines."""
    m = 2 * (p.size - ORDERS)
    level = 2.0 * (1.0 - p[FORGETTING])
    if level == 0.0:
        level = 1e-3
    for k in range(memory.size):
        memory[k] = 0.0
    for i in range(m):
        memory[_THETA + 4 * m + i * m + i] = level


@jit
def regain(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Look the gains of the orders up at the frequency of today."""
    m, frequency = 2 * (p.size - ORDERS), memory[_FREQUENCY]
    if frequency <= 0.0:
        return
    for i in range(p.size - ORDERS):
        gain = gain_at(folded(p[ORDERS + i] * frequency, dt), g)
        memory[_THETA + m + 2 * i], memory[_THETA + m + 2 * i + 1] = gain.real, gain.imag


@leaf
def update(
    error: float, frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray,
    dt: float,
) -> None:  # fmt: skip
    """Take the error y - d [m] at `frequency` [Hz] and accumulated `phase` [rad]."""
    if frequency <= 0.0:
        return
    if frequency != memory[_FREQUENCY]:
        memory[_FREQUENCY] = frequency
        regain(memory, p, g, dt)
    count = p.size - ORDERS
    m = 2 * count
    theta, plant = memory[_THETA : _THETA + m], memory[_THETA + m : _THETA + 2 * m]
    errors, share = (
        memory[_THETA + 2 * m : _THETA + 3 * m],
        memory[_THETA + 3 * m : _THETA + 4 * m],
    )
    covariance = memory[_THETA + 4 * m : _THETA + 4 * m + m * m]
    x, before = scratch(m), scratch(m)
    for i in range(count):
        angle = p[ORDERS + i] * phase
        cosine, sine = math.cos(angle), math.sin(angle)
        real, imaginary = plant[2 * i], plant[2 * i + 1]
        size = math.hypot(real, imaginary)
        x[2 * i] = (cosine * real - sine * imaginary) / size
        x[2 * i + 1] = -(cosine * imaginary + sine * real) / size
        # Slow demodulation, for the report only.
        errors[2 * i] += 5.0 * dt * (2.0 * error * cosine - errors[2 * i])
        errors[2 * i + 1] += 5.0 * dt * (-2.0 * error * sine - errors[2 * i + 1])
    for i in range(m):
        before[i] = share[i]
    rls_update(share, covariance, x, error, p[FORGETTING])
    over = False
    for i in range(count):
        size = math.hypot(plant[2 * i], plant[2 * i + 1])
        for k in range(2 * i, 2 * i + 2):
            theta[k] += (share[k] - before[k]) / size
        size = math.hypot(theta[2 * i], theta[2 * i + 1])
        if size > p[LARGEST]:
            over = True
            theta[2 * i] *= p[LARGEST] / size
            theta[2 * i + 1] *= p[LARGEST] / size
    if over:
        memory[BOUNDED] += 1.0


@leaf
def voltage(
    frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> float:
    """Return what to subtract from the voltage [V] at `phase` [rad]."""
    if frequency <= 0.0:
        return 0.0
    total = 0.0
    for i in range(p.size - ORDERS):
        angle, at = p[ORDERS + i] * phase, _THETA + 2 * i
        total += memory[at] * math.cos(angle) - memory[at + 1] * math.sin(angle)
    return total


@leaf
def disturb(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Continue: the forgetting factor discards a transient."""


# --- what people ask -----------------------------------------------------------------------------


def harmonics(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> list[Harmonic]:
    """Return error and correction of every order."""
    m, rows = 2 * (p.size - ORDERS), []
    for i, order in enumerate(p[ORDERS:].tolist()):
        at = _THETA + 2 * i
        theta = complex(memory[at], memory[at + 1])
        error = complex(memory[at + 2 * m], memory[at + 2 * m + 1])
        rows.append(
            Harmonic(int(order), abs(error), cmath.phase(error), abs(theta), cmath.phase(theta))
        )
    return rows


def counters(memory: FloatArray) -> dict[str, int]:
    """Return how often a correction was held at its bound."""
    return {'bounded': int(memory[BOUNDED])}
