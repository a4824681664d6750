"""Sines with a phase locked to the drive."""

from math import cos, pi, sin

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import inline_jit


@inline_jit
def add_sine(
    x: FloatArray,
    y: FloatArray,
    state: FloatArray,
    sine: float,
    cosine: float,
    dt: float,
    frequency: float,
    order: int,
) -> None:
    """Add a harmonic of the drive; state is (time of the first sample [s], cycles since)."""
    cycles_before, cycles = state[0] * frequency, state[1]
    step = frequency * dt
    on = 1.0 if step > 0.0 else 0.0
    for k in range(x.size):
        angle = 2.0 * pi * order * (cycles_before + cycles)
        y[k] = x[k] + on * (sine * sin(angle) + cosine * cos(angle))
        cycles += step
        cycles -= int(cycles)
    state[1] = cycles


@inline_jit
def add_recursion(
    x: FloatArray,
    y: FloatArray,
    state: FloatArray,
    p: FloatArray,
    dt: float,
    frequency: float,
    order: int,
) -> None:
    """Add ``yn[k] = yn[k-1] + ca yn[k-2] + cb yn[k-3] + al_a sin + al_b cos``.

    State is (time of the first sample [s], cycles since, the last three yn [m]).
    """
    cycles_before, cycles = state[0] * frequency, state[1]
    y1, y2, y3 = state[2], state[3], state[4]
    step = frequency * dt
    on = 1.0 if step > 0.0 else 0.0
    for k in range(x.size):
        angle = 2.0 * pi * order * (cycles_before + cycles)
        new = y1 + p[0] * y2 + p[1] * y3 + on * (p[2] * sin(angle) + p[3] * cos(angle))
        y3 = y2
        y2 = y1
        y1 = new
        y[k] = x[k] + new
        cycles += step
        cycles -= int(cycles)
    state[1] = cycles
    state[2] = y1
    state[3] = y2
    state[4] = y3
