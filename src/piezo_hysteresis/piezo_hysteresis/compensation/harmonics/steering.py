"""State of one cancelled order: correction, last error and estimated gain."""

from __future__ import annotations

import cmath
import math

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.attenuation_settings import (
    LARGEST,
    LARGEST_STEP,
    STEP_SIZE,
)
from piezo_hysteresis.compensation.harmonics.lines import Harmonic
from piezo_hysteresis.jit import jit, leaf

# Weight of the prior estimate relative to clear observations, and their forgetting factor.
_PRIOR = 0.1
_MEMORY = 0.6
# An observation, or an error, is clear where it stands so many deviations out of the noise.
_SIGNIFICANCE = 4.0
# The gain stays within this factor of the modelled magnitude, so that no number overflows: near
# a resonance that was not modelled the true gain is 30 to 300 times it.
_GAIN_RANGE = 1e4
# A clear observation that differs from the estimate by more than this share of the larger one
# replaces it: the mean of two gains of opposite sign is near 0, and a step is divided by it.
_CONTRADICTION = 0.5
_CLEAR = 0.9
# Share of the voltage by which all other orders move that may act on one order: the shape of the
# hysteresis loop, and with it every harmonic, depends on all of the drive.
_CROSS = 0.02
# Share of the largest move of an order below which a move says nothing about the gain: the error
# that remains then changes for other reasons, such as creep.
_SLIGHT = 0.02
# Share of a change that dies out only after its window, of which the next change consists in part.
_UNSETTLED = 0.1
# So many windows of growth in a row, up to what the correction itself does, are divergence.
_RISES = 3

# Places in the memory of a line. Complex numbers take two: correction theta [V], last error [m],
# gain as modelled [m/V] and ratio of the estimated to the modelled gain, last move of
# theta [V], whether a clear observation has confirmed the gain since its last doubt, the size of
# the last change of the error [m], and the largest move so far [V].
ORDER, THETA, ERROR, MODELLED, RATIO, WEIGHT, MOVED, RISES, SEEN = 0, 1, 3, 5, 7, 9, 10, 12, 13
CONFIRMED, CHANGED, FURTHEST = 14, 15, 16
LINE_SIZE = 17


@leaf
def begin_line(line: FloatArray, order: float) -> None:
    """Begin an order without a correction."""
    for k in range(LINE_SIZE):
        line[k] = 0.0
    line[ORDER], line[RATIO], line[WEIGHT] = order, 1.0, _PRIOR


@jit
def gain_estimate(line: FloatArray) -> complex:
    """Return the present estimate of the gain [m/V]."""
    modelled = complex(line[MODELLED], line[MODELLED + 1])
    return modelled * complex(line[RATIO], line[RATIO + 1])


@leaf
def observe(line: FloatArray, change: complex, clearness: float) -> None:
    """Learn from the change of the error [m] that followed the last step."""
    moved = complex(line[MOVED], line[MOVED + 1])
    modelled = complex(line[MODELLED], line[MODELLED + 1])
    if moved == 0.0 or modelled == 0.0:
        return
    seen = -change / moved / modelled
    before = complex(line[RATIO], line[RATIO + 1])
    kept = (1.0 - (1.0 - _MEMORY) * clearness) * line[WEIGHT]
    apart = abs(seen - before) > _CONTRADICTION * max(abs(seen), abs(before))
    if clearness > _CLEAR:
        line[CONFIRMED] = 1.0
        if apart:
            kept = 0.0
    line[WEIGHT] = kept + clearness
    ratio = (kept * before + clearness * seen) / line[WEIGHT]
    size = abs(ratio)
    if size > 0.0:
        ratio *= min(max(size, 1.0 / _GAIN_RANGE), _GAIN_RANGE) / size
        line[RATIO], line[RATIO + 1] = ratio.real, ratio.imag


@leaf
def clearness_of(size: float, deviation: float) -> float:
    """Return 0..1: how clearly an amplitude stands out of the noise."""
    noise = _SIGNIFICANCE * deviation
    return size * size / (size * size + noise * noise) if size > 0.0 else 0.0


@leaf
def withdraw(line: FloatArray) -> None:
    """Revert the last step; the gain is kept but must be confirmed again."""
    for k in range(2):
        line[THETA + k] -= line[MOVED + k]
        line[MOVED + k] = 0.0
    line[SEEN] = line[RISES] = line[CONFIRMED] = line[CHANGED] = 0.0


@leaf
def move(
    line: FloatArray, error: complex, deviation: float, foreign: float, others: float,
    share: float, p: FloatArray,
) -> int:  # fmt: skip
    """Update the gain from the effect of the last step, then take the next step.

    A line whose gain has not been confirmed takes only `share` of that step. `foreign` is a bound
    of other changes of its error [m], `others` the size of the steps of all other orders [V].
    """
    before_error = complex(line[ERROR], line[ERROR + 1])
    moved = complex(line[MOVED], line[MOVED + 1])
    before = theta = complex(line[THETA], line[THETA + 1])
    seen = line[SEEN] > 0.0
    if seen:
        change = error - before_error
        expected = max(abs(change), abs(gain_estimate(line) * moved))
        unclear = math.hypot(foreign, _UNSETTLED * line[CHANGED])
        line[FURTHEST] = max(line[FURTHEST], abs(moved))
        clearness = clearness_of(expected, unclear) * clearness_of(
            abs(moved), math.hypot(_CROSS * others, _SLIGHT * line[FURTHEST])
        )
        observe(line, change, clearness)
        line[CHANGED] = abs(change)
    grown = seen and abs(error) > 1.1 * abs(before_error) + 3.0 * deviation
    line[RISES] = line[RISES] + 1.0 if grown else 0.0
    line[ERROR], line[ERROR + 1], line[SEEN] = error.real, error.imag, 1.0
    gain, happened = gain_estimate(line), 0
    if line[RISES] >= _RISES and abs(error) > 0.5 * abs(gain * theta):
        happened, theta = 1, complex(0.0, 0.0)
        line[RISES] = line[CONFIRMED] = 0.0
    elif gain != 0.0:
        # What may be noise is followed less, so that noise is not fed into the voltage.
        step = p[STEP_SIZE] * clearness_of(abs(error), deviation) * error / gain
        if line[CONFIRMED] == 0.0:
            step *= share
        size = abs(step)
        if size > p[LARGEST_STEP]:
            step *= p[LARGEST_STEP] / size
        theta += step
        if abs(theta) > p[LARGEST]:
            theta *= p[LARGEST] / abs(theta)
            happened = 2
    line[THETA], line[THETA + 1] = theta.real, theta.imag
    line[MOVED], line[MOVED + 1] = theta.real - before.real, theta.imag - before.imag
    return happened


def harmonic_of(line: FloatArray) -> Harmonic:
    """Return the estimate of an order."""
    error, theta = complex(*line[ERROR : ERROR + 2]), complex(*line[THETA : THETA + 2])
    return Harmonic(
        int(line[ORDER]), abs(error), cmath.phase(error), abs(theta), cmath.phase(theta)
    )
