"""Odd-harmonic repetitive control, the rival that Fujii 2018 cites (Li, Gu, Zhu and Su)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.compensation.sensor_guard import (
    DISPLACEMENT,
    FREQUENCY,
    POINT_SIZE,
    READ_DISPLACEMENT,
    READ_SIZE,
    SAMPLE,
    WATCH_SIZE,
    SensorWatch,
    frozen_ticks,
    partner_of,
    write_point,
    write_read,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit, leaf


@dataclass(frozen=True)
class RepetitiveSettings:
    """Settings of `OddRepetitive`.

    Attributes
    ----------
    gain : float
        Quasi-static displacement per volt of the plant [m/V].
    natural_frequency, damping_ratio : float
        Mode that the learning filter cancels [Hz], [1]; 0 Hz for none.
    learning : float
        Share of the error that one half period removes, 0..1.
    lead_ticks : float
        Lead of the learning in samples, for the delay of plant and hold.
    lowest_frequency : float
        Lowest fundamental for learning [Hz]; sets the length of the memory.
    """

    gain: float
    natural_frequency: float = 0.0
    damping_ratio: float = 0.02
    learning: float = 0.3
    lead_ticks: float = 2.5
    lowest_frequency: float = 0.5

    def __post_init__(self) -> None:
        if not self.gain:
            raise CompensationError('repetitive control needs the gain of the plant, not 0 m/V')
        if not 0 < self.learning <= 1:
            raise CompensationError(f'learning must be in 0..1, got {self.learning:g}')
        if self.lead_ticks < 0 or self.lowest_frequency <= 0:
            raise CompensationError('lead_ticks must be 0 or more, lowest_frequency positive')


# Places in the settings; the learning filter comes last.
DT, FROZEN, LEARNING, LEAD, LOWEST, _FILTER = range(6)
# Places in the memory, behind that of the watch: the last two errors that went through the
# learning filter and what it answered, then two rings of the same size: what was learned, and the
# filtered errors.
_PAST, _RINGS = WATCH_SIZE, WATCH_SIZE + 4

# Zero-phase low-pass that is flat up to a fifth of the Nyquist frequency and 0 at it: what the
# learning filter does not invert must not be repeated indefinitely.
_TAPS = (-0.0625, 0.25, 0.625, 0.25, -0.0625)
_REACH = 3  # newest sample that filter and interpolation need, ahead of the requested one


@leaf
def _recall(memory: FloatArray, newest: int, back: float) -> float:
    """Return the ring `memory` `back` samples ago, low-passed; cubic between samples."""
    size = memory.size
    whole = int(np.floor(back))
    t = back - whole
    # Lagrange weights at the samples 1 newer, 0, 1 and 2 older.
    w0 = -t * (t - 1.0) * (t - 2.0) / 6.0
    w1 = (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    w2 = -(t + 1.0) * t * (t - 2.0) / 2.0
    w3 = (t + 1.0) * t * (t - 1.0) / 6.0
    total = 0.0
    for i in range(5):
        place = newest - whole + i - 2
        total += _TAPS[i] * (
            w0 * memory[(place + 1) % size]
            + w1 * memory[place % size]
            + w2 * memory[(place - 1) % size]
            + w3 * memory[(place - 2) % size]
        )
    return total


@jit
def reset_repetitive(memory: FloatArray) -> None:
    """Reset the learned correction; the sensor guard has its own reset."""
    for k in range(_PAST, memory.size):
        memory[k] = 0.0


@leaf
def _filtered(error: float, past: FloatArray, b: FloatArray) -> float:
    """Pass an error [m] through the learning filter; returns [V]."""
    value: float = b[0] * error + b[1] * past[0] + b[2] * past[1] - b[3] * past[2] - b[4] * past[3]
    past[1], past[3] = past[0], past[2]
    past[0], past[2] = error, value
    return value


@jit
def repeat(
    point: FloatArray, read: FloatArray, received: float, memory: FloatArray, settings: FloatArray
) -> float:
    """Return `received` plus the learned correction [V]."""
    size = (memory.size - _RINGS) // 2
    learned, errors = memory[_RINGS : _RINGS + size], memory[_RINGS + size :]
    tick, frequency = int(point[SAMPLE]), point[FREQUENCY]
    place = partner_of(point, read, memory, settings[FROZEN])
    errors[tick % size] = 0.0
    if place >= 0:
        errors[int(memory[place + SAMPLE]) % size] = _filtered(
            memory[place + DISPLACEMENT] - read[READ_DISPLACEMENT],
            memory[_PAST:_RINGS],
            settings[_FILTER:],
        )
    voltage = 0.0
    if frequency >= settings[LOWEST]:
        half = 0.5 / (frequency * settings[DT])
        if half > 2 * _REACH:
            lead = min(settings[LEAD], half - _REACH - 1.0)
            before = _recall(learned, tick, half)
            error = _recall(errors, tick, half - lead)
            voltage = -(before + settings[LEARNING] * error)
    learned[tick % size] = voltage
    return received + voltage


class OddRepetitive:
    """Learns the odd harmonics of the voltage over half periods of the reference.

    ``v(t) = -Q [v + learning L (d - y)](t - T/2)``: the negative feedback over half a period has
    poles on every odd harmonic and leaves the even ones and the mean alone. L cancels the mode
    and looks ahead by the delay of the plant.

    Parameters
    ----------
    settings : RepetitiveSettings
        Plant and tuning.
    dt : float
        Sampling interval [s].
    """

    def __init__(self, settings: RepetitiveSettings, dt: float) -> None:
        s, self.dt = settings, float(dt)
        own = (self.dt, frozen_ticks(dt), s.learning, s.lead_ticks, s.lowest_frequency)
        #: Settings and learning filter, as the kernel reads them.
        self.numbers = np.array([*own, *mode_cancelling(s, dt)], dtype=np.float64)
        self.memory = np.zeros(_RINGS + 2 * (int(0.5 / (s.lowest_frequency * dt)) + 16))
        self._sensor = SensorWatch(dt, memory=self.memory)
        self._point, self._read = np.zeros(POINT_SIZE), np.zeros(READ_SIZE)

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return `received` plus the learned correction [V]."""
        write_point(self._point, point)
        write_read(self._read, measured)
        return repeat(self._point, self._read, float(received), self.memory, self.numbers)

    def counters(self) -> dict[str, int]:
        """Return what the watch over the sensor counted."""
        return self._sensor.counters()

    def reset(self) -> None:
        """Reset the learned correction."""
        self._sensor.reset()
        reset_repetitive(self.memory)


def mode_cancelling(
    settings: RepetitiveSettings, dt: float
) -> tuple[float, float, float, float, float]:
    """Return the biquad that inverts gain and mode with damping, by the bilinear rule."""
    if settings.natural_frequency <= 0.0:
        return 1.0 / settings.gain, 0.0, 0.0, 0.0, 0.0
    omega = 2.0 * math.pi * settings.natural_frequency
    k = omega / math.tan(0.5 * omega * dt)
    squared, over = omega * omega, k * k

    def coefficients(damping: float) -> tuple[float, float, float]:
        middle = 2.0 * damping * omega * k
        return over + middle + squared, 2.0 * (squared - over), over - middle + squared

    n0, n1, n2 = coefficients(settings.damping_ratio)
    d0, d1, d2 = coefficients(1.0)
    scale = 1.0 / (d0 * settings.gain)
    return n0 * scale, n1 * scale, n2 * scale, d1 / d0, d2 / d0
