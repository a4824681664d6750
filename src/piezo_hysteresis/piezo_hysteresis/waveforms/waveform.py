"""Interface of all waveforms: value, rate, acceleration, fundamental frequency and phase."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.numerics.smooth import smooth_ramp


class WaveformError(PiezoError):
    """A requested waveform does not exist or cannot be built."""


@dataclass(frozen=True)
class Samples:
    """A waveform at given times; every array has the shape of the times.

    Attributes
    ----------
    value : ndarray
        The waveform itself, in its own unit (V or m).
    velocity : ndarray
        First time derivative [unit/s] (one-sided where there is a corner).
    acceleration : ndarray
        Second time derivative [unit/s^2] (0 at corners).
    frequency : ndarray
        Instantaneous fundamental frequency [Hz]; 0 if there is none.
    phase : ndarray
        Accumulated phase of the fundamental [rad].
    """

    value: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    frequency: FloatArray
    phase: FloatArray


class Waveform(Protocol):
    """A signal with analytic derivatives; a pure function of time."""

    @property
    def duration(self) -> float:
        """Length [s]."""

    def sample(self, time: FloatArray) -> Samples:
        """Return the waveform at `time` [s], any shape."""


Shape = tuple[FloatArray, FloatArray, FloatArray]
"""A unit shape with its first and second time derivative."""


@dataclass(frozen=True)
class Shaped:
    """Base of all steady excitations: ``offset + ramp(t) amplitude shape(t)``.

    Attributes
    ----------
    amplitude : float
        Amplitude, in the unit of the signal (V or m).
    duration : float
        Length [s].
    offset : float
        Constant added, in the unit of the signal.
    ramp : float
        Seconds over which the amplitude rises smoothly from 0 [s]; 0 starts at once. A lightly
        damped mode rings for long after a start without a ramp.
    """

    amplitude: float
    duration: float
    offset: float = 0.0
    ramp: float = 0.0

    def shape(self, time: FloatArray) -> Shape:
        """Return the shape of amplitude 1 at `time` [s]."""
        raise NotImplementedError

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return frequency [Hz] and phase [rad] of the fundamental; by default there is none."""
        return np.zeros_like(time), np.zeros_like(time)

    def sample(self, time: FloatArray) -> Samples:
        """Return the waveform and its derivatives at `time` [s]."""
        time = np.asarray(time, dtype=np.float64)
        gain, gain_rate, gain_acceleration = smooth_ramp(time, self.ramp)
        shape, rate, acceleration = self.shape(time)
        frequency, phase = self.fundamental(time)
        return Samples(
            value=self.offset + self.amplitude * gain * shape,
            velocity=self.amplitude * (gain_rate * shape + gain * rate),
            acceleration=self.amplitude
            * (gain_acceleration * shape + 2.0 * gain_rate * rate + gain * acceleration),
            frequency=frequency,
            phase=phase,
        )
