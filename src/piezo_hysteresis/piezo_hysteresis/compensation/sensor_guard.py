"""Validation of measurements for a controller, and their assignment to reference ticks."""

from __future__ import annotations

import math
from struct import Struct

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.jit import jit

HISTORY = 256

# Places in a point and in a measurement, as in `ReferencePoint` and `Measured`.
SAMPLE, DISPLACEMENT, VELOCITY, ACCELERATION, FREQUENCY, PHASE = range(6)
POINT_SIZE = 6
READ_SAMPLE, READ_VOLTAGE, READ_DISPLACEMENT = range(3)
READ_SIZE = 3

# Places in the memory of the watch, then the points of the last ticks.
COUNTS = ('missing', 'repeated', 'not_finite', 'unpaired', 'frozen')
_MISSING, _REPEATED, _NOT_FINITE, _UNPAIRED, _FROZEN, _LAST, _READING, _VOLTAGE, _STILL = range(9)
_POINTS = 9
WATCH_SIZE = _POINTS + HISTORY * POINT_SIZE

NONE = math.nan  # the sample of a measurement that is not there

_pack_point = Struct('6d').pack_into
_pack_read = Struct('3d').pack_into


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


def write_point(place: FloatArray, point: ReferencePoint) -> None:
    """Write a point into an array, shape (6,)."""
    _pack_point(place.data, 0, *point)


def write_read(place: FloatArray, measured: Measured | None) -> None:
    """Write a measurement into an array, shape (3,)."""
    if measured is None:
        place[READ_SAMPLE] = NONE
    else:
        _pack_read(place.data, 0, *measured)


class SensorWatch:
    """Pairs each measurement with the reference of its tick and rejects bad ones.

    A measurement that is missing, repeated, not a number, older than the history or frozen is
    counted and not used; the controller then holds what it has learned.
    """

    def __init__(
        self, dt: float, frozen_after: float = 0.05, memory: FloatArray | None = None
    ) -> None:  # dt, frozen_after [s]; memory (WATCH_SIZE,)
        self.frozen_ticks = frozen_ticks(dt, frozen_after)
        self._memory = np.zeros(WATCH_SIZE) if memory is None else memory
        self._point, self._read = np.zeros(POINT_SIZE), np.zeros(READ_SIZE)
        self.reset()

    def reset(self) -> None:
        """Discard all points and counters."""
        reset_watch(self._memory)

    def pair(
        self, point: ReferencePoint, measured: Measured | None
    ) -> tuple[ReferencePoint, float] | None:
        """Return the reference of the measured tick and the displacement [m], or None."""
        write_point(self._point, point)
        write_read(self._read, measured)
        place = partner_of(self._point, self._read, self._memory, self.frozen_ticks)
        if place < 0 or measured is None:
            return None
        sample, *rest = self._memory[place : place + POINT_SIZE].tolist()
        return ReferencePoint(int(sample), *rest), measured.displacement

    @property
    def frozen(self) -> bool:
        """Whether the sensor repeats itself while the voltage moves."""
        return bool(self._memory[_STILL] >= self.frozen_ticks)

    def counters(self) -> dict[str, int]:
        """Return how many measurements were not used, by reason."""
        own = self._memory[: len(COUNTS)]
        return {name: int(count) for name, count in zip(COUNTS, own, strict=True)}


def frozen_ticks(dt: float, frozen_after: float = 0.05) -> float:
    """Return after how many equal readings a sensor counts as frozen."""
    return float(max(3, round(frozen_after / dt)))
