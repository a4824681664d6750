"""What every waveform answers: value, rate, acceleration, fundamental frequency and phase."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from piezo_hysteresis.arrays import FloatArray


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
        Instantaneous fundamental frequency [Hz]; 0 where there is none.
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
        """Answer the waveform at `time` [s], any shape."""
