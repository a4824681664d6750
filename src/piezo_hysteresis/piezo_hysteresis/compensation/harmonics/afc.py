"""Adaptive feedforward cancellation of harmonics by complex gain.

In windows locked to the phase of the reference, the error of each order, ``Re(E exp(j n phi))``,
is estimated by least squares; the correction moves by ``step_size E / G``, and the resulting
change refines G. This tracks a wrong sign, a shifted resonance and steps of the frequency. A step
after which the error of a whole period is 2.5 times that of the previous window is reverted
immediately, and further steps are reduced until an observation confirms the gain. If the error
keeps growing, the order restarts from 0 with the estimated gain.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import (
    AUTOMATIC,
    FIRST_STEP,
    HIGHEST,
    LARGEST,
    LARGEST_STEP,
    MOST,
    ORDERS,
    RESONANCE,
    SETTLE,
    SPAN,
    STEP_SIZE,
    WITH_MEAN,
    Harmonic,
    accumulate,
    factor,
    fill_followed,
    fill_resonant,
    fill_separable,
    folded,
    solve_normal,
)
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.jit import inline_jit, jit, scratch

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


@inline_jit
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


@inline_jit
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


@inline_jit
def clearness_of(size: float, deviation: float) -> float:
    """Return 0..1: how clearly an amplitude stands out of the noise."""
    noise = _SIGNIFICANCE * deviation
    return size * size / (size * size + noise * noise) if size > 0.0 else 0.0


@inline_jit
def withdraw(line: FloatArray) -> None:
    """Revert the last step; the gain is kept but must be confirmed again."""
    for k in range(2):
        line[THETA + k] -= line[MOVED + k]
        line[MOVED + k] = 0.0
    line[SEEN] = line[RISES] = line[CONFIRMED] = line[CHANGED] = 0.0


@inline_jit
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


# Share of the changes of all other lines that may show in one line; 1 to 7 % were seen in the loop
# of a bimorph while its third harmonic was far off.
_COUPLING = 0.03
# Relative change of the frequency from one tick to the next that is a step, not a chirp.
_FREQUENCY_STEP = 2e-3
# Orders that are strong in the error of a hysteretic plant, and one that is where a plant is so
# asymmetric that the second is cancelled. What is strong and not fitted would leak into a short
# window and pass for noise. Which even ones are fitted moves the error left by 3 % at most.
_STRONG = (1.0, 2.0, 3.0, 5.0, 7.0, 9.0)
_STRONG_EVEN = 6.0
_EXTRA = len(_STRONG) + 1
# A step that multiplies the mean square error of a period by more than this is reverted. A full
# step with the wrong sign multiplies it by 1.9^2 = 3.6, is the clearest possible observation, and
# is corrected by the next step.
_HARM = 6.25
# One that multiplies that of a window by less did no harm.
_HARMLESS = 1.2
# Fewest ticks that are compared.
_FEWEST = 16.0
# What becomes of the share of a step after one that is taken back, and after one that did no harm.
_LESS, _MORE = 0.1, 3.0
_LEAST_SHARE = 1e-4

# Largest number of orders that are chosen by themselves.
_CHOSEN = 64

# Places in the memory: the window, its orders, what was counted, then the mean as a line, the
# other lines, the orders that are fitted, the basis and the normal equations.
_FREQUENCY, _TICKS, _SKIP, _LENGTH, _COUNT, _FITTED = range(6)
WINDOWS, RESTARTS, BOUNDED, REVERTED = range(6, 10)
# The share of a step at an uncertain gain; mean square error [m^2] of the last window, 0 for
# none; since the last step the sum of squares, its ticks and the turn it began with.
# The frequency for which orders and gains were chosen last [Hz].
_SHARE, _POWER, _SQUARES, _SQUARED, _TURN, _SCHEDULED = range(10, 16)
# The next row of the fit to be factored.
_FACTORED = 16
_MEAN = 17
_LINES = _MEAN + LINE_SIZE


@inline_jit
def room(p: FloatArray) -> int:
    """Return for how many orders there is room."""
    own = p.size - ORDERS if p[AUTOMATIC] == 0.0 else _CHOSEN
    return own + (MOST if p[RESONANCE] > 0.0 else 0)


@inline_jit
def fitted_at(p: FloatArray) -> int:
    """Return the position of the fitted orders in the memory."""
    return _LINES + LINE_SIZE * room(p)


class Fit(NamedTuple):
    """Layout of the fit of a window in the memory."""

    orders: int  # the fitted orders
    found: int  # the number of separable ones
    basis: int  # the basis of one tick
    size: int  # its number of functions
    normal: int  # the normal equations
    end: int  # their end


@jit
def fit_of(count: int, p: FloatArray) -> Fit:
    """Return where the fit of `count` orders stands."""
    orders = fitted_at(p)
    basis, size = orders + room(p) + _EXTRA, 1 + 2 * count
    normal = basis + size
    return Fit(orders, count, basis, size, normal, normal + (size + 1) * (size + 1))


@jit
def afc_size(p: FloatArray) -> int:
    """Return the size of the memory for packed settings."""
    return fit_of(room(p) + _EXTRA, p).end


@jit
def clear(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Reset every correction."""
    for k in range(memory.size):
        memory[k] = 0.0
    memory[_SHARE] = p[FIRST_STEP]
    begin_line(memory[_MEAN:_LINES], 0.0)


@inline_jit
def update(
    error: float, frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray,
    dt: float,
) -> None:  # fmt: skip
    """Take the error y - d [m] at `frequency` [Hz] and accumulated `phase` [rad]."""
    if frequency <= 0.0:
        memory[_FREQUENCY] = memory[_TICKS] = 0.0
        return
    stepped = abs(frequency - memory[_FREQUENCY]) > _FREQUENCY_STEP * frequency
    if stepped or memory[_COUNT] == 0.0:
        drop_window(frequency, False, memory, p, g, dt)
    memory[_FREQUENCY] = frequency
    memory[_TICKS] += 1.0
    if harmful(error, phase, memory):
        take_back(memory, p, g, dt)
        return
    if memory[_TICKS] <= memory[_SKIP]:
        return
    if memory[_TICKS] <= memory[_SKIP] + memory[_LENGTH]:
        fit = fit_of(int(memory[_FITTED]), p)
        accumulate(
            error,
            phase,
            memory[fit.orders : fit.orders + fit.found],
            memory[fit.basis : fit.normal],
            memory[fit.normal :],
        )
    if memory[_TICKS] >= memory[_SKIP] + memory[_LENGTH]:
        close_window(memory, p, g, dt)


@inline_jit
def harmful(error: float, phase: float, memory: FloatArray) -> bool:
    """Add one error; return whether a period ended with a much larger error than before."""
    turn = math.floor(phase / (2.0 * math.pi))
    if memory[_SQUARED] == 0.0:
        memory[_TURN] = turn
    ended = turn != memory[_TURN] and memory[_SQUARED] >= _FEWEST
    worse = False
    if ended:
        power = memory[_SQUARES] / memory[_SQUARED]
        worse = memory[_POWER] > 0.0 and power > _HARM * memory[_POWER]
        memory[_SQUARES], memory[_SQUARED], memory[_TURN] = 0.0, 0.0, turn
    memory[_SQUARES] += error * error
    memory[_SQUARED] += 1.0
    return worse


@inline_jit
def take_back(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Take the last step of every line back, and measure again before the next one."""
    memory[REVERTED] += 1.0
    memory[_SHARE] = max(_LESS * memory[_SHARE], _LEAST_SHARE)
    withdraw(memory[_MEAN:_LINES])
    for i in range(int(memory[_COUNT])):
        withdraw(memory[_LINES + LINE_SIZE * i : _LINES + LINE_SIZE * (i + 1)])
    drop_window(memory[_FREQUENCY], False, memory, p, g, dt)


@inline_jit
def retreat(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Put every correction to 0; the gains are kept, but are to be confirmed again."""
    memory[_SHARE] = max(_LESS * memory[_SHARE], _LEAST_SHARE)
    for i in range(-1, int(memory[_COUNT])):
        line = memory[_MEAN + LINE_SIZE * (i + 1) : _MEAN + LINE_SIZE * (i + 2)]
        line[THETA] = line[THETA + 1] = line[MOVED] = line[MOVED + 1] = 0.0
        withdraw(line)
    if memory[_FREQUENCY] > 0.0:
        drop_window(memory[_FREQUENCY], False, memory, p, g, dt)


@inline_jit
def voltage(
    frequency: float, phase: float, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> float:
    """Return what to subtract from the voltage [V] at `phase` [rad]."""
    total = memory[_MEAN + THETA]
    for i in range(int(memory[_COUNT])):
        line = _LINES + LINE_SIZE * i
        real, imaginary = memory[line + THETA], memory[line + THETA + 1]
        if real != 0.0 or imaginary != 0.0:
            angle = memory[line + ORDER] * phase
            total += real * math.cos(angle) - imaginary * math.sin(angle)
    return float(total)


@inline_jit
def disturb(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Restart the window and discard the effect of the last step."""
    if memory[_FREQUENCY] > 0.0:
        drop_window(memory[_FREQUENCY], False, memory, p, g, dt)


@jit
def regain(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Set a new model of the plant gain; its estimated correction is kept."""
    if memory[_FREQUENCY] > 0.0:
        reschedule(memory[_FREQUENCY], False, memory, p, g, dt)


@inline_jit
def drop_window(
    frequency: float, kept: bool, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> None:
    """Begin a window; choose its length and orders for `frequency`.

    If the lines are `kept`, their state from the last window remains valid.
    """
    periods = max(1, round(p[SPAN] * frequency))
    memory[_LENGTH] = round(periods / (frequency * dt))
    # There is no change before the first window, so no settling time is needed.
    fresh = memory[WINDOWS] == 0.0 and memory[_FREQUENCY] == 0.0
    settle = max(round(p[SETTLE] / dt), int(memory[_LENGTH]) // 2)
    memory[_SKIP] = 0.0 if fresh else settle
    memory[_TICKS] = memory[_SQUARES] = memory[_SQUARED] = memory[_FACTORED] = 0.0
    if not kept:
        memory[_POWER] = 0.0
    # At an unchanged frequency the orders are the same; the gain of many takes long to evaluate.
    if not (kept and frequency == memory[_SCHEDULED]):
        choose_orders(frequency, memory, p, g, dt)
        reschedule(frequency, kept, memory, p, g, dt)
    fit = fit_of(int(memory[_FITTED]), p)
    for k in range(fit.normal, fit.end):
        memory[k] = 0.0


@inline_jit
def choose_orders(
    frequency: float, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> None:
    """Choose the orders that are cancelled and the additional fitted ones."""
    most, own = room(p), p.size - ORDERS
    span = memory[_LENGTH] * dt
    every, kept = scratch(most + _EXTRA + 1), scratch(most + _EXTRA + 1)
    if p[AUTOMATIC] > 0.0:
        own = fill_followed(frequency, g, dt, every[:_CHOSEN])
    else:
        for i in range(own):
            every[i] = p[ORDERS + i]
    count = own
    if p[RESONANCE] > 0.0:
        count += fill_resonant(frequency, p[RESONANCE], dt, HIGHEST, every[own : own + MOST])
    number = count
    every[count] = 1.0
    found = fill_separable(every[: count + 1], frequency, dt, span, kept)
    take_lines(memory, kept[:found], every[:number], most)
    for order in _STRONG:
        every[count] = order
        count += 1
    for i in range(number):
        if every[i] == 2.0:
            every[count] = _STRONG_EVEN
            count += 1
    first = fitted_at(p)
    memory[_FITTED] = fill_separable(every[:count], frequency, dt, span, memory[first:])


@inline_jit
def take_lines(memory: FloatArray, kept: FloatArray, wanted: FloatArray, most: int) -> None:
    """Carry the lines of the orders `kept` that are `wanted` on, and begin those that are new."""
    before, old = scratch(LINE_SIZE * most), int(memory[_COUNT])
    for k in range(LINE_SIZE * old):
        before[k] = memory[_LINES + k]
    count = 0
    for order in kept:
        asked = False
        for each in wanted:
            asked = asked or each == order
        if not asked:
            continue
        line = memory[_LINES + LINE_SIZE * count : _LINES + LINE_SIZE * (count + 1)]
        begin_line(line, order)
        for i in range(old):
            if before[LINE_SIZE * i + ORDER] == order:
                for k in range(LINE_SIZE):
                    line[k] = before[LINE_SIZE * i + k]
        count += 1
    memory[_COUNT] = count


@inline_jit
def reschedule(
    frequency: float, kept: bool, memory: FloatArray, p: FloatArray, g: FloatArray, dt: float
) -> None:
    """Carry each line to `frequency`: the correction stays, the gain moves as modelled."""
    memory[_SCHEDULED] = frequency
    for i in range(int(memory[_COUNT])):
        line = memory[_LINES + LINE_SIZE * i : _LINES + LINE_SIZE * (i + 1)]
        gain = gain_at(folded(line[ORDER] * frequency, dt), g)
        line[MODELLED], line[MODELLED + 1] = gain.real, gain.imag
        if not kept:
            line[RISES] = line[SEEN] = line[MOVED] = line[MOVED + 1] = line[CHANGED] = 0.0
    memory[_MEAN + MODELLED] = gain_at(0.0, g).real
    memory[_MEAN + MODELLED + 1] = 0.0


@inline_jit
def close_window(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> None:
    """Solve the fit of the window that has ended, then learn from it and begin the next."""
    fit = fit_of(int(memory[_FITTED]), p)
    normal, ticks = memory[fit.normal : fit.end], memory[_LENGTH]
    memory[_FACTORED] = factor(normal, fit.size, ticks, int(memory[_FACTORED]))
    if memory[_FACTORED] <= fit.size:
        return
    solution = scratch(fit.size)
    deviation = solve_normal(normal, ticks, solution)
    if not math.isfinite(deviation):  # no step without information
        drop_window(memory[_FREQUENCY], True, memory, p, g, dt)
        return
    memory[WINDOWS] += 1.0
    # The last row is the error in an orthonormal basis, and what the fit leaves of it.
    power = 0.0
    for k in range(normal.size - fit.size - 1, normal.size):
        power += normal[k] * normal[k]
    evaluate_window(power / ticks, memory)
    count = int(memory[_COUNT])
    with_mean = p[WITH_MEAN] > 0.0
    errors, changes = scratch((count + 1, 2)), scratch(count + 1)
    total = moves = 0.0
    # the mean is the last one
    for i in range(count + (1 if with_mean else 0)):
        at = _LINES + LINE_SIZE * i if i < count else _MEAN
        errors[i, 0], errors[i, 1] = solution[0], 0.0
        if i < count:
            for k in range(fit.found):
                if memory[fit.orders + k] == memory[at + ORDER]:
                    errors[i, 0], errors[i, 1] = solution[1 + 2 * k], solution[2 + 2 * k]
        moved = math.hypot(
            errors[i, 0] - memory[at + ERROR], errors[i, 1] - memory[at + ERROR + 1]
        )
        changes[i] = moved if memory[at + SEEN] > 0.0 else 0.0
        total += changes[i]
        moves += math.hypot(memory[at + MOVED], memory[at + MOVED + 1])
    # The hysteresis couples the orders: a change of one line may result from steps of others.
    for i in range(count + (1 if with_mean else 0)):
        at = _LINES + LINE_SIZE * i if i < count else _MEAN
        foreign = math.hypot(deviation, _COUPLING * (total - changes[i]))
        own = math.hypot(memory[at + MOVED], memory[at + MOVED + 1])
        happened = move(
            memory[at : at + LINE_SIZE],
            complex(errors[i, 0], errors[i, 1]),
            deviation,
            foreign,
            moves - own,
            memory[_SHARE],
            p,
        )
        memory[RESTARTS] += 1.0 if happened == 1 else 0.0
        memory[BOUNDED] += 1.0 if happened == 2 else 0.0
    memory[_MEAN + THETA + 1] = 0.0
    drop_window(memory[_FREQUENCY], True, memory, p, g, dt)


@inline_jit
def evaluate_window(power: float, memory: FloatArray) -> None:
    """Take the mean square error [m^2] of a window: without harm the next steps may be larger."""
    if 0.0 < power <= _HARMLESS * memory[_POWER]:
        memory[_SHARE] = min(_MORE * memory[_SHARE], 1.0)
    memory[_POWER] = power


# --- what people ask -----------------------------------------------------------------------------


def harmonics(memory: FloatArray, p: FloatArray, g: FloatArray, dt: float) -> list[Harmonic]:
    """Return error and correction of every order."""
    rows = [_MEAN] if p[WITH_MEAN] > 0.0 else []
    rows += [_LINES + LINE_SIZE * i for i in range(int(memory[_COUNT]))]
    found = [harmonic_of(memory[row : row + LINE_SIZE]) for row in rows]
    return sorted(found, key=lambda each: each.order)


def gains(memory: FloatArray) -> dict[int, complex]:
    """Return the present estimate of the plant gain [m/V] by order."""
    rows = (_LINES + LINE_SIZE * i for i in range(int(memory[_COUNT])))
    lines = (memory[row : row + LINE_SIZE] for row in rows)
    return {int(line[ORDER]): complex(gain_estimate(line)) for line in lines}


def counters(memory: FloatArray) -> dict[str, int]:
    """Return windows evaluated, orders restarted or held at their bound, steps taken back."""
    names = ('windows', 'restarts', 'bounded', 'reverted')
    counts = memory[WINDOWS : REVERTED + 1]
    return {name: int(count) for name, count in zip(names, counts, strict=True)}
