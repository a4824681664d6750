"""Chirps: sinusoids with a swept frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.waveform import Shape, Shaped, WaveformError

LAWS = ('linear', 'logarithmic')


@dataclass(frozen=True)
class Chirp(Shaped):
    """A sine with a frequency that is swept from `frequency` to `highest` over the duration.

    Attributes
    ----------
    frequency, highest : float
        Frequencies at the start and at the end [Hz].
    law : str
        ``linear``: constant hertz per second; ``logarithmic``: constant octaves per second.
    """

    frequency: float = 1.0
    highest: float = 100.0
    law: str = 'linear'

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise WaveformError(f'there is no chirp law {self.law!r}; there are {", ".join(LAWS)}')

    def _run(self, time: FloatArray) -> Shape:
        """Return phase [rad], frequency [Hz] and its rate [Hz/s]."""
        first, last, length = self.frequency, self.highest, self.duration
        if self.law == 'linear' or first == last:
            slope = (last - first) / length
            frequency = first + slope * time
            phase = 2.0 * np.pi * (first + 0.5 * slope * time) * time
            return phase, frequency, np.full_like(time, slope)
        growth = np.log(last / first) / length
        frequency = first * np.exp(growth * time)
        phase = 2.0 * np.pi * first * np.expm1(growth * time) / growth
        return phase, frequency, growth * frequency

    def shape(self, time: FloatArray) -> Shape:
        """Return the sine for the amplitude 1."""
        phase, frequency, slope = self._run(time)
        omega = 2.0 * np.pi * frequency
        sine, cosine = np.sin(phase), np.cos(phase)
        return sine, omega * cosine, 2.0 * np.pi * slope * cosine - omega**2 * sine

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the instantaneous frequency and the phase."""
        phase, frequency, _ = self._run(time)
        return frequency, phase
