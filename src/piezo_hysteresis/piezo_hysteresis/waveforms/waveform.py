"""Interface of all waveforms: value, rate, acceleration, fundamental frequency and phase."""

from __future__ import annotations

from dataclasses import dataclass, fields
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


@dataclass(frozen=True)
class Sequence:
    """Waveforms in sequence; the phase continues from the previous one.

    Attributes
    ----------
    parts : tuple of Waveform
        At least one; each runs for its duration, the last one continues.
    """

    parts: tuple[Waveform, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise WaveformError('a sequence needs at least one part')

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(sum(part.duration for part in self.parts))

    def sample(self, time: FloatArray) -> Samples:
        """Return the sequence at `time` [s]."""
        time = np.asarray(time, dtype=np.float64)
        starts = np.cumsum([0.0, *(part.duration for part in self.parts[:-1])])
        chosen = np.clip(np.searchsorted(starts, time, side='right') - 1, 0, len(self.parts) - 1)
        columns = {entry.name: np.zeros_like(time) for entry in fields(Samples)}
        phase = 0.0
        for index, (part, start) in enumerate(zip(self.parts, starts, strict=True)):
            mask = chosen == index
            samples = part.sample(time[mask] - start)
            for name, column in columns.items():
                column[mask] = getattr(samples, name)
            columns['phase'][mask] += phase
            phase += float(part.sample(np.array([part.duration])).phase[0])
        return Samples(**columns)
