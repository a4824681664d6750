"""Fujii 2018 (18)-(23): recursive least squares of the error's harmonic.

The error e (y - d, or d - y by the printed rule), in V by ``settings.gain``, is fitted as Fujii
2018's third equation of (6): ``e[k] - e[k-1] = c3 e[k-2] + c4 e[k-3] + alpha . u3[k]``; the
correction is ``alpha . u3``. For steady errors this is proportional feedback of the harmonic with
the factor ``kappa = 1 - z^-1 - c3 z^-2 - c4 z^-3``; with G the plant gain it attenuates by
``1 / |1 + s kappa G|`` and is stable where ``|arg(s kappa G)|`` is below 90 degrees. The computed
rule turns the correction so that this angle is 0 at every order.
"""

from __future__ import annotations

import cmath
import math

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import (
    COMPUTED,
    ERROR_GAIN,
    FORGETTING,
    LARGEST,
    ORDERS,
    PRINTED,
    RECURSIVE,
    SIGN_RULE,
    SWITCH,
    Harmonic,
)
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.jit import inline_jit, jit, scratch

# Above this trace per parameter the covariance is scaled down: forgetting without excitation
# would let it grow indefinitely.
_LARGEST_COVARIANCE = 1e6

# Places in the memory: the frequency of the last error, what was counted, past errors, the
# frequency that the gains below belong to; then gains, unknowns, covariance.
_FREQUENCY, BOUNDED, _PAST, _GAINS_OF, _GAINS = 0, 1, 2, 5, 6


@inline_jit
def rls_update(
    theta: FloatArray,
    covariance: FloatArray,
    regressor: FloatArray,
    error: float,
    forgetting: float,
) -> None:
    """Update RLS by one equation; `error` is the present residual.

    The covariance is a square matrix in row order.
    """
    m = theta.size
    power = forgetting
    work = scratch(m)
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += covariance[i * m + j] * regressor[j]
        work[i] = total
        power += regressor[i] * total
    trace = 0.0
    for i in range(m):
        theta[i] += work[i] / power * error
        for j in range(i + 1):
            value = (covariance[i * m + j] - work[i] * work[j] / power) / forgetting
            covariance[i * m + j] = value
            covariance[j * m + i] = value
        trace += covariance[i * m + i]
    if trace > _LARGEST_COVARIANCE * m:
        scale = _LARGEST_COVARIANCE * m / trace
        for i in range(m * m):
            covariance[i] *= scale


@inline_jit
def unknowns(p: FloatArray) -> int:
    """Return how many unknowns there are."""
    return (2 if p[RECURSIVE] > 0.0 else 0) + 2 * (p.size - ORDERS)


@inline_jit
def unknowns_at(p: FloatArray) -> int:
    """Return the position of the unknowns in the memory."""
    return _GAINS + 2 * (p.size - ORDERS)


@jit
def rls_size(p: FloatArray) -> int:
    """Return the size of the memory for packed settings."""
    m = unknowns(p)
    return unknowns_at(p) + m + m * m


@jit
def clear(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Reset every correction; the covariance is the identity, as in Fujii 2018."""
    m, place = unknowns(p), unknowns_at(p)
    for k in range(memory.size):
        memory[k] = 0.0
    for i in range(m):
        memory[place + m + i * m + i] = 1.0


@inline_jit
def update(
    error: float, frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray,
    dt: float,
) -> None:  # fmt: skip
    """Fit Fujii 2018 (18), (19) to the error y - d [m] at `frequency` [Hz], `phase` [rad]."""
    if frequency <= 0.0:
        return
    memory[_FREQUENCY] = frequency
    value = error * p[ERROR_GAIN]
    m, place = unknowns(p), unknowns_at(p)
    first = m - 2 * (p.size - ORDERS)
    x, target = scratch(m), value
    if first:
        x[0], x[1] = memory[_PAST + 1], memory[_PAST + 2]
        target = value - memory[_PAST]
    for i in range(p.size - ORDERS):
        angle = p[ORDERS + i] * phase
        x[first + 2 * i], x[first + 2 * i + 1] = math.sin(angle), math.cos(angle)
    theta = memory[place : place + m]
    missed = target
    for i in range(m):
        missed -= theta[i] * x[i]
    rls_update(theta, memory[place + m : place + m + m * m], x, missed, p[FORGETTING])
    memory[_PAST + 2], memory[_PAST + 1] = memory[_PAST + 1], memory[_PAST]
    memory[_PAST] = value


@inline_jit
def voltage(
    frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> float:
    """Return what Fujii 2018 (20), (21) subtract from the voltage [V] at `phase` [rad]."""
    if frequency <= 0.0:
        return 0.0
    if p[SIGN_RULE] == COMPUTED and memory[_GAINS_OF] != frequency:
        memory[_GAINS_OF] = frequency
        for i in range(p.size - ORDERS):
            gain = gain_at(p[ORDERS + i] * frequency, g)
            memory[_GAINS + 2 * i], memory[_GAINS + 2 * i + 1] = gain.real, gain.imag
    total = 0.0
    for i in range(p.size - ORDERS):
        theta = correction(i, frequency, memory, p, dt)
        angle = p[ORDERS + i] * phase
        total += theta.real * math.cos(angle) - theta.imag * math.sin(angle)
    return total


@jit
def kappa(frequency: float, memory: FloatArray, p: FloatArray, dt: float) -> complex:
    """Return the factor of the recursion at a frequency [Hz]."""
    if p[RECURSIVE] == 0.0:
        return complex(1.0, 0.0)
    angle, place = 2.0 * math.pi * frequency * dt, unknowns_at(p)
    z = complex(math.cos(angle), -math.sin(angle))
    return complex(1.0 - z - memory[place] * z * z - memory[place + 1] * z * z * z)


@jit
def alpha(i: int, memory: FloatArray, p: FloatArray) -> complex:
    """Return alpha of order i as a phasor [V]: sin goes with -j in Re(. exp(j n phi))."""
    first = unknowns_at(p) + unknowns(p) - 2 * (p.size - ORDERS) + 2 * i
    return complex(memory[first + 1], -memory[first])


@jit
def correction(i: int, frequency: float, memory: FloatArray, p: FloatArray, dt: float) -> complex:
    """Return the correction of order i as a phasor [V]; saturation at its bound is counted.

    The sign by the printed rule is Fujii 2018 (22), (23).
    """
    line, theta = p[ORDERS + i] * frequency, alpha(i, memory, p)
    if p[SIGN_RULE] == PRINTED and line <= p[SWITCH]:
        theta = -theta
    elif p[SIGN_RULE] == COMPUTED:
        gain = complex(memory[_GAINS + 2 * i], memory[_GAINS + 2 * i + 1])
        loop = kappa(line, memory, p, dt) * gain
        size = abs(loop)
        if size > 0.0:
            theta *= complex(loop.real, -loop.imag) / size
    size = abs(theta)
    if size > p[LARGEST]:
        theta *= p[LARGEST] / size
        memory[BOUNDED] += 1.0
    return theta


@inline_jit
def disturb(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Continue: the forgetting factor discards a transient."""


@jit
def regain(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Take a new model of the plant gain."""
    memory[_GAINS_OF] = 0.0


# --- what people ask -----------------------------------------------------------------------------


def harmonics(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> list[Harmonic]:
    """Return error and correction of every order."""
    rows = []
    frequency, seen = float(memory[_FREQUENCY]), memory.copy()  # asking counts nothing
    for i, order in enumerate(p[ORDERS:].tolist()):
        factor = kappa(order * frequency, memory, p, dt)
        error = alpha(i, memory, p) / factor / p[ERROR_GAIN] if factor else 0j
        theta = correction(i, frequency, seen, p, dt)
        rows.append(
            Harmonic(int(order), abs(error), cmath.phase(error), abs(theta), cmath.phase(theta))
        )
    return rows


def counters(memory: FloatArray) -> dict[str, int]:
    """Return how often a correction was held at its bound."""
    return {'bounded': int(memory[BOUNDED])}
