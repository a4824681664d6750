"""Interface of a link of the voltage chain, and its guard against a failed sensor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.smooth import STEEPEST, smooth_step

# What `inverse_for` can be asked for: the best there is, a paper's own law (as in CITATION.cff),
# the exact inverse of one Bouc-Wen block, the numeric one of any chain, or a mere gain.
INVERSES = (
    'auto', 'fujii2018', 'tatebatake2017', 'zhou2021', 'xiao2014', 'fang2019', 'exact', 'numeric',
    'gain',
)  # fmt: skip


class ReferencePoint(NamedTuple):
    """The reference at one tick.

    Attributes
    ----------
    sample : int
        Number of the tick.
    displacement, velocity, acceleration : float
        Desired displacement [m] and its derivatives [m/s], [m/s^2].
    frequency : float
        Fundamental frequency [Hz]; 0 where there is none.
    phase : float
        Accumulated phase of the fundamental [rad].
    """

    sample: int
    displacement: float
    velocity: float
    acceleration: float
    frequency: float
    phase: float


class Measured(NamedTuple):
    """The newest measurement available to a link; in lock-step that of the previous tick.

    Attributes
    ----------
    sample : int
        Number of the tick it belongs to.
    voltage : float
        What was commanded at that tick [V].
    displacement : float
        What was measured at that tick, before that voltage acted [m].
    """

    sample: int
    voltage: float
    displacement: float


class Link(Protocol):
    """One link of the chain: adds its share to the voltage that it receives.

    A feedforward link is the first of the chain and receives 0.
    """

    def step(self, point: ReferencePoint, received: float, measured: Measured | None) -> float:
        """Return the voltage to pass on [V]."""

    def reset(self) -> None:
        """Reset the state; the parameters stay."""

    def counters(self) -> dict[str, int]:
        """Return the counters of faults, by name (clamped slopes, limited samples, ...)."""


@dataclass(frozen=True)
class Limits:
    """What no link ever exceeds.

    Attributes
    ----------
    low, high : float
        Range of the commanded voltage [V].
    slew : float
        Largest change [V/s].
    """

    low: float = -1.2
    high: float = 1.2
    slew: float = 1000.0


# Places in the memory of a change: whether one is asked for, what the output would have jumped by,
# ticks so far, how long it takes [s], the last output and whether there was one.
PENDING, BUMP, _ELAPSED, _LENGTH, LAST, _STARTED = range(6)
FADE_SIZE = 6
# Places in the memory of a cross-fade: ticks so far (-1 for none), the share before it, the last
# share and whether there was one.
_TICKS, _BEFORE, _SHARE, _SHARED = range(4)
CROSS_SIZE = 4


@jit
def fade(raw: float, memory: FloatArray, dt: float, duration: float, slew: float) -> float:
    """Return the output of this tick [V]; `raw` is what the law in charge wants."""
    if memory[PENDING] > 0.0 and memory[_STARTED] > 0.0:
        memory[PENDING] = 0.0
        memory[BUMP] = memory[LAST] - raw
        memory[_ELAPSED] = 0.0
        memory[_LENGTH] = max(duration, dt, STEEPEST * abs(memory[BUMP]) / slew)
    output = raw
    if memory[BUMP] != 0.0:
        done = memory[_ELAPSED] * dt / memory[_LENGTH]
        if done >= 1.0:
            memory[BUMP] = 0.0
        else:
            output += memory[BUMP] * (1.0 - smooth_step(done)[0])
            memory[_ELAPSED] += 1.0
    memory[LAST], memory[_STARTED] = output, 1.0
    return output


@jit
def begin_fade(memory: FloatArray) -> None:
    """Make the next output begin where the last one was."""
    memory[PENDING] = memory[_STARTED]


@jit
def reset_fade(memory: FloatArray) -> None:
    """Reset the last output and any running transition."""
    memory[PENDING] = memory[BUMP] = memory[_STARTED] = 0.0


@jit
def cross_fade(raw: float, memory: FloatArray, dt: float, duration: float) -> float:
    """Return the share of this tick [V]: the old one fades out while `raw` fades in."""
    share = raw
    if memory[_TICKS] >= 0.0:
        done = memory[_TICKS] * dt / max(duration, dt)
        share = memory[_BEFORE] + smooth_step(done)[0] * (raw - memory[_BEFORE])
        memory[_TICKS] = -1.0 if done >= 1.0 else memory[_TICKS] + 1.0
    memory[_SHARE], memory[_SHARED] = share, 1.0
    return share


@jit
def begin_cross(memory: FloatArray) -> None:
    """Make the next share begin where the last one was, if there was one."""
    if memory[_SHARED] > 0.0:
        memory[_BEFORE], memory[_TICKS] = memory[_SHARE], 0.0


@jit
def reset_cross(memory: FloatArray) -> None:
    """Reset the last share and any running transition."""
    memory[_TICKS], memory[_SHARED] = -1.0, 0.0


class Transition:
    """Bumpless change: holds what the output would have jumped by and lets it fade.

    A step in the voltage strikes a lightly damped mode, so the difference fades along a quintic
    smooth step, whose velocity and acceleration are continuous.
    """

    _begin, _clear, _size = staticmethod(begin_fade), staticmethod(reset_fade), FADE_SIZE

    def __init__(
        self,
        dt: float,  # [s]
        duration: float = 0.2,  # [s]
        slew: float = math.inf,  # [V/s]
    ) -> None:
        self._dt, self._memory = float(dt), np.zeros(self._size)
        self.retune(duration, slew)
        self.reset()

    def start(self) -> None:
        """Make the next output begin where the last one was, if there was one."""
        self._begin(self._memory)

    def retune(self, duration: float, slew: float) -> None:
        """Change how long [s] and how fast [V/s] changes may be, from the next one on."""
        self._duration, self._slew = float(duration), float(slew)

    def apply(self, raw: float) -> float:
        """Return the output for this tick [V]; `raw` is what the law in charge wants."""
        return fade(float(raw), self._memory, self._dt, self._duration, self._slew)

    def reset(self) -> None:
        """Discard the last output and any running transition."""
        self._clear(self._memory)


class CrossFade(Transition):
    """Fades the old share out and the new one in; the limiter alone limits its slew.

    A law that learns from the measurement answers wildly at first. It so begins with no weight,
    where `Transition` would pass its first answers on.
    """

    _begin, _clear, _size = staticmethod(begin_cross), staticmethod(reset_cross), CROSS_SIZE

    def apply(self, raw: float) -> float:
        """Return the share for this tick [V]; `raw` is what the law in charge wants."""
        return cross_fade(float(raw), self._memory, self._dt, self._duration)


HISTORY = 256

# Places in a point and in a measurement, as in `ReferencePoint` and `Measured`.
SAMPLE, DISPLACEMENT, VELOCITY, ACCELERATION, FREQUENCY, PHASE = range(6)
POINT_SIZE = 6
READ_SAMPLE, READ_VOLTAGE, READ_DISPLACEMENT = range(3)
READ_SIZE = 3
GIVEN_SIZE = POINT_SIZE + READ_SIZE  # both, one behind the other

# Places in the memory of the watch, then the points of the last ticks.
COUNTS = ('missing', 'repeated', 'not_finite', 'unpaired', 'frozen')
_MISSING, _REPEATED, _NOT_FINITE, _UNPAIRED, _FROZEN, _LAST, _READING, _VOLTAGE, _STILL = range(9)
_POINTS = 9
WATCH_SIZE = _POINTS + HISTORY * POINT_SIZE

NONE = math.nan  # the sample of a measurement that is not there
# Time of equal readings while the voltage moves, after which a sensor is frozen [s].
_FROZEN_AFTER = 0.05

_pack_point = Struct('6d').pack_into
_pack_given = Struct('9d').pack_into


@jit
def reset_watch(memory: FloatArray) -> None:
    """Reset every point and counter."""
    for k in range(_POINTS):
        memory[k] = 0.0
    memory[_LAST] = -1.0
    memory[_READING] = memory[_VOLTAGE] = math.nan
    for k in range(HISTORY):
        memory[_POINTS + k * POINT_SIZE] = -1.0


@jit
def partner_of(
    point: FloatArray, read: FloatArray, memory: FloatArray, frozen_ticks: float
) -> int:  # point (6,); read (3,); memory (WATCH_SIZE,)
    """Return the index of the reference of the measured tick in the memory; -1 for none."""
    place = _POINTS + POINT_SIZE * (int(point[SAMPLE]) % HISTORY)
    for k in range(POINT_SIZE):
        memory[place + k] = point[k]
    sample = read[READ_SAMPLE]
    if sample != sample:
        if memory[_LAST] >= 0.0:
            memory[_MISSING] += 1.0
        return -1
    if sample <= memory[_LAST]:
        memory[_REPEATED] += 1.0
        return -1
    if not math.isfinite(read[READ_DISPLACEMENT]):
        memory[_NOT_FINITE] += 1.0
        return -1
    memory[_LAST] = sample
    partner = _POINTS + POINT_SIZE * (int(sample) % HISTORY)
    if memory[partner] != sample:
        memory[_UNPAIRED] += 1.0
        return -1
    if read[READ_DISPLACEMENT] != memory[_READING]:
        memory[_READING] = read[READ_DISPLACEMENT]
        memory[_STILL] = 0.0
    elif read[READ_VOLTAGE] != memory[_VOLTAGE]:
        memory[_STILL] += 1.0
    memory[_VOLTAGE] = read[READ_VOLTAGE]
    if memory[_STILL] >= frozen_ticks:
        memory[_FROZEN] += 1.0
        return -1
    return partner


def write_given(place: FloatArray, point: ReferencePoint, measured: Measured | None) -> None:
    """Write a point and a measurement into an array, shape (9,)."""
    if measured is None:
        _pack_point(place.data, 0, *point)
        place[POINT_SIZE] = NONE
    else:
        _pack_given(place.data, 0, *point, *measured)


def watch_counters(memory: FloatArray) -> dict[str, int]:
    """Return how many measurements were not used, by reason."""
    return {name: int(count) for name, count in zip(COUNTS, memory, strict=False)}


def frozen_ticks(dt: float) -> float:
    """Return after how many equal readings a sensor counts as frozen."""
    return float(max(3, round(_FROZEN_AFTER / dt)))


# Answers of `CompiledLaw.take`.
OK, IMPOSSIBLE = 0, -3


class CompiledLaw(NamedTuple):
    """A link as kernels on its memory and its numbers, which Python, the nodes and C share."""

    name: str  # of its node and its parameter table
    # ``step(given, received, memory, numbers)`` [V]; `given` are a point and a measurement
    step: Callable[..., float]
    reset: Callable[[FloatArray, FloatArray], None]  # ``reset(memory, numbers)``
    # ``take(values, bounds, memory, numbers, first)`` sets values and limits, the latter in the
    # order low, high, slew, power, capacitance, window; it returns OK, or IMPOSSIBLE unchanged
    take: Callable[[FloatArray, FloatArray, FloatArray, FloatArray, bool], int]
    settable: tuple[tuple[str, float], ...]  # parameters of that table that `take` sets last


class CompiledLink:
    """A link that is a kernel on its memory and its numbers, the packed settings."""

    def __init__(self, kernel: Callable[..., float], numbers: FloatArray, size: int) -> None:
        self.kernel, self.numbers, self.memory = kernel, numbers, np.zeros(size)
        self._given = np.zeros(GIVEN_SIZE)

    def step(
        self, point: ReferencePoint, received: float = 0.0, measured: Measured | None = None
    ) -> float:
        """Return the voltage to pass on [V], which is `received` plus the share of the law."""
        write_given(self._given, point, measured)
        return self.kernel(self._given, float(received), self.memory, self.numbers)
