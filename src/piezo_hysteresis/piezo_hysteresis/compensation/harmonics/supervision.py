"""Supervision of a correction: it fades out if it increases the error, and restarts later.

The mean square of the error over whole periods is compared with that of a window without a
correction. If it is persistently larger, the correction fades out and the error is measured
without it. If the error is then smaller, the correction was harmful: it restarts from 0 after a
wait that doubles with each failure, and fades in more slowly each time if it learns during the
fade. Otherwise the error has another cause and the correction fades in again. The comparison is an
experiment, so it needs no model of the plant and applies to every law.

A law that learns from windows begins once the error has settled: the transient of the start is no
harmonic, and a correction of it would be the error of the following windows.
"""

from __future__ import annotations

import math

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit, leaf

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
