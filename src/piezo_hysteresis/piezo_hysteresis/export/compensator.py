"""A chain of links and the limiter as one function of the library."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import carray

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.limiter import LIMITER_SIZE, slow_enough
from piezo_hysteresis.compensation.link import GIVEN_SIZE, IMPOSSIBLE, OK
from piezo_hysteresis.export.header import UNINITIALISED, Component, Field, checking, component
from piezo_hysteresis.export.native import Entry
from piezo_hysteresis.export.sections import Section, in_chain
from piezo_hysteresis.jit import inline_jit, scratch

# Indices in the memory: mark of initialisation, number of ticks, last voltage, last reference;
# then the sections.
_MARK, _TICK, _VOLTAGE, _ASKED = range(4)
HEAD = 4
# Indices in the input: reference and its derivatives, frequency, phase, measurement, its age
# [ticks].
D, V, A, F, PHI, MEASURED, AGE = range(7)
INPUT_SIZE = 7

# Status bits of a step.
REFERENCE_REFUSED, NOT_USED, OUT_OF_RANGE, SLEW_LIMITED, NOT_FINITE = 1, 2, 4, 8, 16
ENERGY_LIMITED = 32

# Indices of the limits, which are the first fields of the struct.
LOW, HIGH, SLEW, POWER, CAPACITANCE, WINDOW = range(6)
LIMITS = 6

# As in `condition`: beyond the range of any actuator.
ABSURD, _ABSURD_RATE = 1e3, 1e9


@inline_jit
def is_absurd(x: FloatArray) -> bool:
    """Return whether the reference of an input is no number, or beyond any actuator."""
    return not (abs(x[D]) < ABSURD and abs(x[V]) < _ABSURD_RATE and abs(x[A]) < _ABSURD_RATE)


@inline_jit
def take_input(
    x: FloatArray, tick: float, last: FloatArray, nyquist: float, given: FloatArray
) -> int:
    """Fill a point and a measurement from the input of an axis; return the bits of refusals.

    `last` are the last voltage, and the last reference, which is replaced.
    """
    code, given[0] = OK, tick
    for k in range(5):
        given[1 + k] = x[k]
    if is_absurd(x):
        given[1], given[2], given[3] = last[1], 0.0, 0.0
        code |= REFERENCE_REFUSED
    if not (x[F] >= 0.0 and x[F] < nyquist and abs(x[PHI]) < 1e15):
        given[4] = given[5] = 0.0
        code |= REFERENCE_REFUSED
    last[1] = given[1]
    given[6], given[7], given[8] = np.nan, last[0], x[MEASURED]
    if x[AGE] >= 0.5 and x[AGE] <= tick:
        given[6] = tick - np.floor(x[AGE] + 0.5)
    if not abs(x[MEASURED]) < ABSURD:
        given[8] = np.nan
        code |= NOT_USED
    return code


@inline_jit
def limiter_bits(before: FloatArray, counts: FloatArray) -> int:
    """Return the bits of those counts of a limiter that have changed."""
    code = OK
    if counts[0] != before[0]:
        code |= NOT_FINITE
    if counts[1] != before[1]:
        code |= OUT_OF_RANGE
    if counts[2] != before[2]:
        code |= SLEW_LIMITED
    if counts[3] != before[3]:
        code |= ENERGY_LIMITED
    return code


def compensator_of(
    sections: Sequence[Section], limits: Sequence[Field], dt: float, mark: float
) -> Component:  # dt [s]
    """Return the chain of `sections`, of which the last is the limiter.

    Its ``step(s, x, voltage)`` returns the bits above.
    """
    whole = functools.reduce(in_chain, sections)
    fields, size = (*limits, *whole.fields), HEAD + whole.start.size
    take_whole, reset_whole = whole.take, whole.reset
    safe = min(max(0.0, fields[0].value), fields[1].value)

    @inline_jit
    def take(values: FloatArray, s: FloatArray, first: bool) -> int:
        return int(take_whole(values[LIMITS:], values[:LIMITS], s[HEAD:], first))

    @inline_jit
    def reset(s: FloatArray) -> None:
        reset_whole(s[HEAD:])
        s[_TICK] = s[_ASKED] = s[_VOLTAGE] = 0.0

    start = np.concatenate([np.zeros(HEAD), whole.start])
    rows = (('head', HEAD), *((section.name, section.start.size) for section in sections))
    step = _stepping(whole.step, size, 0.5 / dt, mark, safe)
    return component(step, _judging(fields, dt), take, reset, start, mark, fields, rows)


def _judging(fields: Sequence[Field], dt: float) -> Callable[[FloatArray], int]:
    """Return the kernel of the check of values: 0, or the reason of a rejection."""
    check = checking(fields)

    @inline_jit
    def judge(values: FloatArray) -> int:
        code = check(values)
        if code == OK and not values[LOW] < values[HIGH]:
            code = IMPOSSIBLE
        if code == OK and not slow_enough(dt / values[WINDOW]):
            code = IMPOSSIBLE
        return int(code)

    return judge


def _stepping(
    chain: Any, size: int, nyquist: float, mark: float, safe: float
) -> Callable[[FloatArray, FloatArray, FloatArray], int]:
    counts = size - LIMITER_SIZE + 2

    @inline_jit
    def step(s: FloatArray, x: FloatArray, voltage: FloatArray) -> int:
        if s[_MARK] != mark:
            voltage[0] = safe
            return UNINITIALISED
        given, before = scratch(GIVEN_SIZE), scratch(4)
        code = take_input(x, s[_TICK], s[_VOLTAGE:HEAD], nyquist, given)
        for k in range(4):
            before[k] = s[counts + k]
        answer = chain(given, 0.0, s[HEAD:])
        s[_TICK], s[_VOLTAGE] = s[_TICK] + 1.0, answer
        voltage[0] = answer
        return code | limiter_bits(before, s[counts:])

    return step


def compensator_doors(name: str, chain: Component, axes: int = 1) -> list[Entry]:
    """Return the functions of a chain under the name of the library."""
    run, size, inputs = chain.step, chain.size, axes * INPUT_SIZE

    @inline_jit
    def step(s: Any, x: Any, voltages: Any) -> int:
        return run(carray(s, (size,)), carray(x, (inputs,)), carray(voltages, (axes,)))

    return [Entry(f'{name}_step', step, 'ppp'), *common_doors(name, chain)]


def plant_doors(name: str, plant: Component) -> list[Entry]:
    """Return the functions of a free run under the name of the library."""
    run, size = plant.step, plant.size

    @inline_jit
    def step(s: Any, voltage: float, displacement: Any) -> int:
        return run(carray(s, (size,)), voltage, carray(displacement, (1,)))

    return [Entry(f'{name}_step', step, 'pdp'), *common_doors(name, plant)]


def common_doors(name: str, part: Component) -> list[Entry]:
    """Return the functions that begin, change and reset a state."""
    begin, change, reset_state, size = part.begin, part.change, part.reset, part.size
    count = len(part.fields)

    @inline_jit
    def init(s: Any, values: Any) -> int:
        return begin(carray(s, (size,)), carray(values, (count,)))

    @inline_jit
    def take(s: Any, values: Any) -> int:
        return change(carray(s, (size,)), carray(values, (count,)))

    @inline_jit
    def reset(s: Any) -> int:
        return reset_state(carray(s, (size,)))

    return [
        Entry(f'{name}_defaults', _defaults(part.fields), 'p'),
        Entry(f'{name}_init', init, 'pp'),
        Entry(f'{name}_set', take, 'pp'),
        Entry(f'{name}_reset', reset, 'p'),
    ]


def _defaults(fields: Sequence[Field]) -> Any:
    known = np.array([field.value for field in fields])
    count = known.size

    @inline_jit
    def defaults(values: Any) -> int:
        place = carray(values, (count,))
        for k in range(count):
            place[k] = known[k]
        return 0

    return defaults
