"""Sinusoids, the excitation and the reference of 000 (13), (24)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.base import Samples


@dataclass(frozen=True)
class Sine:
    """``offset + ramp(t) amplitude sin(2 pi frequency t + phase)``.

    Attributes
    ----------
    amplitude : float
        Amplitude, in the unit of the signal (V or m).
    frequency : float
        Frequency [Hz].
    duration : float
        Length [s].
    offset : float
        Constant added, in the unit of the signal.
    phase : float
        Phase at time 0 [rad].
    ramp : float
        Seconds over which the amplitude rises smoothly from 0 [s]; 0 starts at once. A lightly
        damped mode rings for long after a start without a ramp.
    """

    amplitude: float
    frequency: float
    duration: float
    offset: float = 0.0
    phase: float = 0.0
    ramp: float = 0.0

    def sample(self, time: FloatArray) -> Samples:
        """Answer the sinusoid and its derivatives at `time` [s]."""
        time = np.asarray(time, dtype=np.float64)
        omega = 2.0 * np.pi * self.frequency
        phase = omega * time + self.phase
        gain, gain_rate, gain_acceleration = smooth_ramp(time, self.ramp)
        sine, cosine = np.sin(phase), np.cos(phase)
        return Samples(
            value=self.offset + self.amplitude * gain * sine,
            velocity=self.amplitude * (gain_rate * sine + gain * omega * cosine),
            acceleration=self.amplitude
            * (gain_acceleration * sine + 2 * gain_rate * omega * cosine - gain * omega**2 * sine),
            frequency=np.full_like(phase, self.frequency),
            phase=phase,
        )


def smooth_ramp(time: FloatArray, length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Answer a rise from 0 to 1 over `length` seconds, with its first two derivatives.

    The quintic smooth step: value, velocity and acceleration are continuous, so a lightly damped
    mode is not struck.
    """
    if length <= 0:
        return np.ones_like(time), np.zeros_like(time), np.zeros_like(time)
    s = np.clip(time / length, 0.0, 1.0)
    value = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    velocity = 30.0 * s**2 * (1.0 - s) ** 2 / length
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / length**2
    return value, velocity, acceleration
