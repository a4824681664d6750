"""A sine that dies away: it brings an actuator with memory to the same remanence every time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.waveform import Shape, Shaped


@dataclass(frozen=True)
class Decay(Shaped):
    """A sine with one full period, whose amplitude then decays to 0 at the end.

    Each period erases the memory of smaller ones, so that the actuator retains no history from
    before the largest one.

    Attributes
    ----------
    frequency : float
        Frequency [Hz].
    """

    frequency: float = 10.0

    def shape(self, time: FloatArray) -> Shape:
        """Return the sine of amplitude 1 that dies away."""
        omega = 2.0 * np.pi * self.frequency
        fading = max(self.duration - 1.0 / self.frequency, 0.5 * self.duration)
        left = np.clip((self.duration - time) / fading, 0.0, 1.0)
        fall = np.where((left > 0.0) & (left < 1.0), -1.0 / fading, 0.0)
        sine, cosine = np.sin(omega * time), omega * np.cos(omega * time)
        return (
            left * sine,
            left * cosine + fall * sine,
            2.0 * fall * cosine - left * omega**2 * sine,
        )

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return frequency and phase."""
        return (np.full_like(time, self.frequency), 2.0 * np.pi * self.frequency * time)
