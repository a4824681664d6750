"""Fujii 2018 (18)-(23): recursive least squares of the error's harmonic, supervised.

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
from piezo_hysteresis.jit import jit, leaf, scratch

# Above this trace per parameter the covariance is scaled down: forgetting without excitation
# would let it grow indefinitely.
_LARGEST_COVARIANCE = 1e6

# Places in the memory: the frequency of the last error, what was counted, past errors, the
# frequency that the gains below belong to; then gains, unknowns, covariance.
_FREQUENCY, BOUNDED, _PAST, _GAINS_OF, _GAINS = 0, 1, 2, 5, 6


@leaf
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


@leaf
def unknowns(p: FloatArray) -> int:
    """Return how many unknowns there are."""
    return (2 if p[RECURSIVE] > 0.0 else 0) + 2 * (p.size - ORDERS)


@leaf
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


@leaf
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


@leaf
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


@leaf
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


# Shortest window, the time over which a correction fades, and by how much longer it takes to fade
# in after each failure [s].
_SPAN, _FADE, _SLOWER = 0.25, 0.2, 2.0
# Wait after the first failure, doubled by each further one up to the longest [s].
_WAIT, _LONGEST = 1.0, 60.0
# Shortest time between two experiments that found no harm, doubled by each further one [s].
_PAUSE = 2.0
# Mean square error, as a multiple of that without a correction, that is suspicious in so many
# windows in a row; that is suspicious at once; and that is so after the frequency has changed, for
# which there is no measurement without a correction yet.
_LARGER, _WINDOWS, _FAR, _STALE = 1.21, 10.0, 25.0, 4.0
# The correction is harmful if it increases the mean square error by this factor.
_HARM = 1.1
# Below this share of the error without it a correction is successful: failures are reset.
_SUCCESS = 0.25
# Relative change of the frequency after which the measurement without a correction is stale.
_CHANGE = 0.05

# The error has settled if its mean squares in two successive windows differ by less than this
# factor. These windows are shorter [s]; after so many of them the law begins regardless.
_SETTLED, _STARTING_SPAN, _MOST_STARTING = 1.25, 0.125, 16.0

RUNNING, MEASURING, WAITING, STARTING = range(4)
# Requests of `supervise` to the law.
NOTHING, RETREAT, RESUME = range(3)

# Places in the memory: state; weight of the correction; mean square error without it [m^2], the
# amplitude of the reference then [m], its frequency [Hz] and whether both still hold; the window:
# sum of squares, sum, ticks, turn it began with; suspicious windows in a row; mean square error
# before the experiment; failures and harmless experiments in a row; time that is left [s]; how
# often a correction was faded out for good, how many experiments there were, and windows since the
# start.
(
    STATE, WEIGHT, BASE, SIZE, FREQUENCY, VALID, SQUARES, SUM, TICKS, TURN, RISES, BEFORE,
    FAILURES, CHECKS, LEFT, BACKED_OFF, CHECKED, STARTED,
) = range(18)  # fmt: skip
GUARD_SIZE = 18


@jit
def reset_guard(memory: FloatArray, fading: bool) -> None:
    """Reset: the correction has its full weight, and learns at once if it may while `fading`."""
    for k in range(GUARD_SIZE):
        memory[k] = 0.0
    memory[WEIGHT] = 1.0
    memory[STATE] = RUNNING if fading else STARTING


@leaf
def learns(memory: FloatArray, fading: bool) -> bool:
    """Return whether the law may learn from the error: in full force, or while `fading` in too."""
    return bool(memory[STATE] == RUNNING and (fading or memory[WEIGHT] == 1.0))


@leaf
def fade(memory: FloatArray, fading: bool, dt: float) -> float:
    """Take one tick; return the weight of the correction, 0..1.

    A law that learns while `fading` in does so more slowly after each failure.
    """
    if memory[STATE] == STARTING:
        return 1.0
    if memory[STATE] == RUNNING:
        time = _FADE + (_SLOWER * memory[FAILURES] if fading else 0.0)
        memory[WEIGHT] = min(memory[WEIGHT] + dt / time, 1.0)
    else:
        memory[WEIGHT] = max(memory[WEIGHT] - dt / _FADE, 0.0)
    return float(memory[WEIGHT])


@leaf
def empty_window(memory: FloatArray) -> None:
    """Begin a window."""
    memory[SQUARES] = memory[SUM] = memory[TICKS] = 0.0


@leaf
def supervise(
    error: float, frequency: float, phase: float, size: float, disturbed: bool, with_mean: bool,
    settle: float, memory: FloatArray, dt: float,
) -> int:  # fmt: skip
    """Process the error of one tick."""
    # error, size [m]; frequency [Hz]; phase [rad]; settle, dt [s]; memory (GUARD_SIZE,)
    if memory[STATE] == RUNNING:
        memory[LEFT] = max(memory[LEFT] - dt, 0.0)
        if memory[WEIGHT] < 1.0:
            empty_window(memory)
            return RESUME
    elif memory[STATE] == STARTING:
        pass
    elif memory[WEIGHT] > 0.0:
        memory[LEFT] = max(memory[LEFT], settle)
        return NOTHING
    elif memory[LEFT] > 0.0:
        memory[LEFT] -= dt
        empty_window(memory)
        return NOTHING
    if frequency <= 0.0 or size <= 0.0 or disturbed:
        empty_window(memory)
        return NOTHING
    turn = math.floor(phase / (2.0 * math.pi))
    if memory[TICKS] == 0.0:
        memory[TURN] = turn
    answer = NOTHING
    span = _STARTING_SPAN if memory[STATE] == STARTING else _SPAN
    if turn != memory[TURN] and memory[TICKS] * dt >= span:
        mean = memory[SUM] / memory[TICKS]
        power = memory[SQUARES] / memory[TICKS] - (0.0 if with_mean else mean * mean)
        empty_window(memory)
        memory[TURN] = turn
        answer = judge(power, frequency, size, memory)
    memory[SQUARES] += error * error
    memory[SUM] += error
    memory[TICKS] += 1.0
    return answer


@leaf
def doubled(time: float, times: float) -> float:
    """Return a time [s] doubled `times` times, at most the longest."""
    for _ in range(int(times)):
        time = min(2.0 * time, _LONGEST)
    return time


@leaf
def judge(power: float, frequency: float, size: float, memory: FloatArray) -> int:
    """Evaluate the mean square error [m^2] of a window."""
    before = memory[BASE]
    if memory[STATE] != RUNNING or memory[BASE] == 0.0:
        memory[BASE], memory[SIZE], memory[FREQUENCY] = power, size, frequency
        memory[VALID], memory[RISES] = 1.0, 0.0
    elif is_larger(power, frequency, size, memory):
        memory[STATE], memory[BEFORE] = MEASURING, power
        memory[CHECKED] += 1.0
        return NOTHING
    if memory[STATE] == STARTING:
        memory[STARTED] += 1.0
        settled = max(power, before) <= _SETTLED * min(power, before)
        if not settled and memory[STARTED] < _MOST_STARTING:
            return NOTHING
    if memory[STATE] == MEASURING:
        if memory[BEFORE] > _HARM * power:
            memory[LEFT] = doubled(_WAIT, memory[FAILURES])
            memory[FAILURES] += 1.0
            memory[BACKED_OFF] += 1.0
            memory[STATE] = WAITING
            return RETREAT
        memory[LEFT] = doubled(_PAUSE, memory[CHECKS])
        memory[CHECKS] += 1.0
    memory[STATE] = RUNNING
    return NOTHING


@leaf
def is_larger(power: float, frequency: float, size: float, memory: FloatArray) -> bool:
    """Return whether the error [m^2] exceeds that without correction enough to test it."""
    if abs(frequency - memory[FREQUENCY]) > _CHANGE * memory[FREQUENCY]:
        memory[VALID] = 0.0
    larger = size / memory[SIZE]
    base = memory[BASE] * max(1.0, larger * larger)
    if power < _SUCCESS * base:
        memory[FAILURES] = memory[CHECKS] = 0.0
    bound = (_LARGER if memory[VALID] > 0.0 else _STALE) * base
    # An error larger than the reference is suspicious, regardless of the measurement without it.
    suspicious = power > min(bound, max(0.5 * size * size, base))
    memory[RISES] = memory[RISES] + 1.0 if suspicious else 0.0
    far = memory[RISES] >= _WINDOWS or power > _FAR * base
    return bool(far and memory[LEFT] == 0.0)


def guard_counters(memory: FloatArray) -> dict[str, int]:
    """Return how often the correction backed off, was put to the test, and whether it is off."""
    return {
        'backed_off': int(memory[BACKED_OFF]),
        'tested': int(memory[CHECKED]),
        'faded_out': int(memory[STATE] == WAITING),
    }
