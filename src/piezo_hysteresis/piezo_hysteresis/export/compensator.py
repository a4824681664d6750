"""A chain of links and the limiter as one function of the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import carray

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.limiter import LIMITER_SIZE, slow_enough
from piezo_hysteresis.compensation.link import GIVEN_SIZE, IMPOSSIBLE, OK, POINT_SIZE
from piezo_hysteresis.export.header import UNINITIALISED, Component, Field, checking
from piezo_hysteresis.export.native import Entry
from piezo_hysteresis.export.sections import Section
from piezo_hysteresis.jit import leaf, scratch

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


@leaf
def is_absurd(x: FloatArray) -> bool:
    """Return whether the reference of an input is no number, or beyond any actuator."""
    return not (abs(x[D]) < ABSURD and abs(x[V]) < _ABSURD_RATE and abs(x[A]) < _ABSURD_RATE)


def compensator_of(
    sections: Sequence[Section], limits: Sequence[Field], dt: float, mark: float
) -> Component:  # dt [s]
    """Return the chain of `sections`, of which the last is the limiter.

    Its ``step(s, x, voltage)`` returns the bits above.
    """
    fields = (*limits, *(field for section in sections for field in section.fields))
    step: Any = _pass
    reset: Any = _no_reset
    take: Any = _take_nothing
    size, place = HEAD, len(limits)
    for section in sections:
        end, last = size + section.start.size, place + len(section.fields)
        step = _then(step, section, size, end)
        reset = _and(reset, section, size, end)
        take = _taking(take, section, (size, end), (place, last))
        size, place = end, last
    rest = fields[0].value, fields[1].value
    safe = min(max(0.0, rest[0]), rest[1])
    judge = _judging(fields, dt)
    return Component(
        _stepping(step, size, 0.5 / dt, mark, safe),
        _beginning(judge, reset, take, sections, size, mark),
        _changing(judge, take, mark),
        _resetting(reset, mark),
        size,
        fields,
        (('head', HEAD), *((section.name, section.start.size) for section in sections)),
    )


@leaf
def _pass(given: FloatArray, received: float, s: FloatArray) -> float:
    return received


@leaf
def _no_reset(s: FloatArray) -> None:
    return


@leaf
def _take_nothing(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
    return OK


def _then(before: Any, section: Section, begin: int, end: int) -> Any:
    step = section.step

    @leaf
    def both(given: FloatArray, received: float, s: FloatArray) -> float:
        passed = before(given, received, s)
        return step(given, passed, s[begin:end])

    return both


def _and(before: Any, section: Section, begin: int, end: int) -> Any:
    reset = section.reset

    @leaf
    def both(s: FloatArray) -> None:
        before(s)
        reset(s[begin:end])

    return both


def _taking(
    before: Any, section: Section, own: tuple[int, int], values_of: tuple[int, int]
) -> Any:
    take, (begin, end), (first_value, last_value) = section.take, own, values_of

    @leaf
    def both(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        # only the model can reject values, so it is first
        code = before(values, bounds, s, first)
        if code != OK:
            return int(code)
        return take(values[first_value:last_value], bounds, s[begin:end], first)

    return both


def _judging(fields: Sequence[Field], dt: float) -> Callable[[FloatArray], int]:
    """Return the kernel of the check of values: 0, or the reason of a rejection."""
    check = checking(fields)

    @leaf
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

    @leaf
    def step(s: FloatArray, x: FloatArray, voltage: FloatArray) -> int:
        if s[_MARK] != mark:
            voltage[0] = safe
            return UNINITIALISED
        asked, code = scratch(GIVEN_SIZE), 0
        point, read = asked[:POINT_SIZE], asked[POINT_SIZE:]
        tick = s[_TICK]
        point[0] = tick
        for k in range(5):
            point[1 + k] = x[k]
        if is_absurd(x):
            point[1], point[2], point[3] = s[_ASKED], 0.0, 0.0
            code |= REFERENCE_REFUSED
        if not (x[F] >= 0.0 and x[F] < nyquist and abs(x[PHI]) < 1e15):
            point[4] = point[5] = 0.0
            code |= REFERENCE_REFUSED
        s[_ASKED] = point[1]
        read[0], read[1], read[2] = np.nan, s[_VOLTAGE], x[MEASURED]
        if x[AGE] >= 0.5 and x[AGE] <= tick:
            read[0] = tick - np.floor(x[AGE] + 0.5)
        if not abs(x[MEASURED]) < ABSURD:
            read[2] = np.nan
            code |= NOT_USED
        out, slowed, refused = s[counts + 1], s[counts + 2], s[counts]
        spared = s[counts + 3]
        given = chain(asked, 0.0, s)
        if s[counts] != refused:
            code |= NOT_FINITE
        if s[counts + 1] != out:
            code |= OUT_OF_RANGE
        if s[counts + 2] != slowed:
            code |= SLEW_LIMITED
        if s[counts + 3] != spared:
            code |= ENERGY_LIMITED
        s[_TICK], s[_VOLTAGE] = tick + 1.0, given
        voltage[0] = given
        return code

    return step


def _beginning(
    judge: Any, reset: Any, take: Any, sections: Sequence[Section], size: int, mark: float
) -> Callable[[FloatArray, FloatArray], int]:
    """Return the kernel that initialises a state; the packed values of all sections are copied."""
    copies = [np.trim_zeros(np.concatenate([section.start, [0.0]]), 'b') for section in sections]
    starts = np.cumsum([HEAD, *(section.start.size for section in sections)])[:-1]
    places = np.concatenate(
        [np.arange(start, start + copy.size) for start, copy in zip(starts, copies, strict=True)]
    ).astype(np.int64)
    numbers = np.concatenate(copies)
    total = numbers.size

    @leaf
    def begin(s: FloatArray, values: FloatArray) -> int:
        s[_MARK] = 0.0
        code = judge(values)
        if code != OK:
            return int(code)
        for k in range(size):
            s[k] = 0.0
        for k in range(total):
            s[places[k]] = numbers[k]
        code = take(values, values[:LIMITS], s, True)
        if code != OK:
            return int(code)
        reset(s)
        s[_MARK] = mark
        return OK

    return begin


def _changing(judge: Any, take: Any, mark: float) -> Callable[[FloatArray, FloatArray], int]:
    @leaf
    def change(s: FloatArray, values: FloatArray) -> int:
        if s[_MARK] != mark:
            return UNINITIALISED
        code = judge(values)
        if code != OK:
            return int(code)
        return int(take(values, values[:LIMITS], s, False))

    return change


def _resetting(reset: Any, mark: float) -> Callable[[FloatArray], int]:
    @leaf
    def reset_all(s: FloatArray) -> int:
        if s[_MARK] != mark:
            return UNINITIALISED
        reset(s)
        s[_TICK] = s[_ASKED] = s[_VOLTAGE] = 0.0
        return OK

    return reset_all


def compensator_doors(name: str, chain: Component) -> list[Entry]:
    """Return the functions of a chain under the name of the library."""
    run, size = chain.step, chain.size

    @leaf
    def step(s: Any, x: Any, voltage: Any) -> int:
        return run(carray(s, (size,)), carray(x, (INPUT_SIZE,)), carray(voltage, (1,)))

    return [Entry(f'{name}_step', step, 'ppp'), *common_doors(name, chain)]


def plant_doors(name: str, plant: Component) -> list[Entry]:
    """Return the functions of a free run under the name of the library."""
    run, size = plant.step, plant.size

    @leaf
    def step(s: Any, voltage: float, displacement: Any) -> int:
        return run(carray(s, (size,)), voltage, carray(displacement, (1,)))

    return [Entry(f'{name}_step', step, 'pdp'), *common_doors(name, plant)]


def common_doors(name: str, part: Component) -> list[Entry]:
    """Return the functions that begin, change and reset a state."""
    begin, change, reset_state, size = part.begin, part.change, part.reset, part.size
    count = len(part.fields)

    @leaf
    def init(s: Any, values: Any) -> int:
        return begin(carray(s, (size,)), carray(values, (count,)))

    @leaf
    def take(s: Any, values: Any) -> int:
        return change(carray(s, (size,)), carray(values, (count,)))

    @leaf
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

    @leaf
    def defaults(values: Any) -> int:
        place = carray(values, (count,))
        for k in range(count):
            place[k] = known[k]
        return 0

    return defaults
