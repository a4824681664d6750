"""One order that is cancelled: its correction, its last error, and the gain as it is believed."""

from __future__ import annotations

import cmath

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import Harmonic
from piezo_hysteresis.compensation.harmonics.settings import LARGEST, LARGEST_STEP, STEP_SIZE
from piezo_hysteresis.jit import jit

# What was believed before weighs this much against clear observations, which fade by the memory.
_PRIOR = 0.1
_MEMORY = 0.6
# An observation, or an error, is clear where it stands so many deviations out of the noise.
_SIGNIFICANCE = 4.0
# The gain stays within this factor of the modelled magnitude; its phase is free.
_GAIN_RANGE = 8.0
# So many windows of growth in a row, up to what the correction itself does, are divergence.
_RISES = 3

# Places in the memory of a line. Complex numbers take two: correction theta [V], last error [m],
# gain as modelled [m/V] and the ratio by which the one that is believed differs, last move of
# theta [V].
ORDER, THETA, ERROR, MODELLED, RATIO, WEIGHT, MOVED, RISES, SEEN = 0, 1, 3, 5, 7, 9, 10, 12, 13
LINE_SIZE = 14


@jit
def begin_line(line: FloatArray, order: float) -> None:
    """Begin an order without a correction."""
    for k in range(LINE_SIZE):
        line[k] = 0.0
    line[ORDER], line[RATIO], line[WEIGHT] = order, 1.0, _PRIOR


@jit
def believed(line: FloatArray) -> complex:
    """Return the gain [m/V] as it is believed now."""
    modelled = complex(line[MODELLED], line[MODELLED + 1])
    return modelled * complex(line[RATIO], line[RATIO + 1])


@jit
def observe(line: FloatArray, change: complex, clearness: float) -> None:
    """Learn from the change of the error [m] that followed the last step."""
    moved = complex(line[MOVED], line[MOVED + 1])
    modelled = complex(line[MODELLED], line[MODELLED + 1])
    if moved == 0.0 or modelled == 0.0:
        return
    seen = -change / moved / modelled
    kept = _MEMORY * line[WEIGHT]
    line[WEIGHT] = kept + clearness
    ratio = (kept * complex(line[RATIO], line[RATIO + 1]) + clearness * seen) / line[WEIGHT]
    size = abs(ratio)
    if size > 0.0:
        ratio *= min(max(size, 1.0 / _GAIN_RANGE), _GAIN_RANGE) / size
        line[RATIO], line[RATIO + 1] = ratio.real, ratio.imag


@jit
def clearness_of(size: float, deviation: float) -> float:
    """Return 0..1: how clearly an amplitude stands out of the noise."""
    noise = _SIGNIFICANCE * deviation
    return size * size / (size * size + noise * noise) if size > 0.0 else 0.0


@jit
def move(line: FloatArray, error: complex, deviation: float, foreign: float, p: FloatArray) -> int:
    """Refine the gain from what the last step did, then take the next step.

    Returns
    -------
    int
        1 where the order begins anew, 2 where its correction is held at the bound, else 0.
    """
    before_error = complex(line[ERROR], line[ERROR + 1])
    moved = complex(line[MOVED], line[MOVED + 1])
    before = theta = complex(line[THETA], line[THETA + 1])
    seen = line[SEEN] > 0.0
    if seen:
        change = error - before_error
        expected = max(abs(change), abs(believed(line) * moved))
        observe(line, change, clearness_of(expected, foreign))
    grown = seen and abs(error) > 1.1 * abs(before_error) + 3.0 * deviation
    line[RISES] = line[RISES] + 1.0 if grown else 0.0
    line[ERROR], line[ERROR + 1], line[SEEN] = error.real, error.imag, 1.0
    gain, happened = believed(line), 0
    if line[RISES] >= _RISES and abs(error) > 0.5 * abs(gain * theta):
        happened, theta = 1, complex(0.0, 0.0)
        line[RISES], line[RATIO], line[RATIO + 1], line[WEIGHT] = 0.0, 1.0, 0.0, _PRIOR
    elif gain != 0.0:
        # What may be noise is followed less, so that noise is not fed into the voltage.
        step = p[STEP_SIZE] * clearness_of(abs(error), deviation) * error / gain
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
    """Return what is known of an order."""
    error, theta = complex(*line[ERROR : ERROR + 2]), complex(*line[THETA : THETA + 2])
    return Harmonic(
        int(line[ORDER]), abs(error), cmath.phase(error), abs(theta), cmath.phase(theta)
    )
