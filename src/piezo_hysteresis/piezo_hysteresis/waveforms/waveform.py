"""Interface of all waveforms, and the waveform of given samples."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import median_filter

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.common.cached_property import cached_property
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


# Correlation with itself a period later, from which samples count as periodic.
_PERIODIC = 0.99
# Difference below which two correlations are equal.
_EQUAL = 3e-3
# Fewest samples of a spline, fourth difference of a corner over the median of so many on either
# side, share of the range below which a difference is rounding, and share of the largest second
# difference of a corner from which a sample belongs to it.
_SPLINE, _CORNER, _NEAR, _ROUNDING, _SHARE = 8, 30.0, 24, 1e-9, 0.05


@dataclass(frozen=True, eq=False)
class Sampled:
    """Samples at a constant rate, with the derivatives of splines from corner to corner."""

    values: FloatArray  # in the unit of the signal (V or m); the last one is held, shape (n,)
    dt: float  # sampling interval [s]

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, np.float64)
        if values.ndim != 1 or values.size < 2 or not np.all(np.isfinite(values)):
            raise WaveformError(
                f'samples are a series of finite numbers, got an array of shape {values.shape}'
            )
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise WaveformError(f'the sampling interval must be positive, got {self.dt!r} s')
        object.__setattr__(self, 'values', values)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.values.size * self.dt

    @cached_property
    def frequency(self) -> float:
        """Frequency of the shortest period with which the samples repeat [Hz]; 0 if they do not.

        A period must lie twice in the samples.
        """
        centered = self.values - self.values.mean()
        size = centered.size
        spectrum = np.fft.rfft(centered, 2 * size)
        lags = np.arange(size // 2 + 1)
        both = np.fft.irfft(np.abs(spectrum) ** 2)[lags]
        energy = np.concatenate([[0.0], np.cumsum(centered**2)])
        norm = np.sqrt(energy[size - lags] * (energy[size] - energy[lags]))
        alike = np.divide(both, norm, out=np.zeros_like(both), where=norm > 0)
        apart = np.flatnonzero(alike < 0.5)
        if not apart.size:
            return 0.0
        inner = np.arange(max(int(apart[0]), 1), alike.size - 1)
        tops = inner[(alike[inner] >= alike[inner - 1]) & (alike[inner] > alike[inner + 1])]
        places, heights = _summits(alike, tops)
        best = np.flatnonzero(heights > max(_PERIODIC, heights.max(initial=0.0) - _EQUAL))
        if not best.size:
            return 0.0
        period = places[best[0]]
        # several periods give the length of one to a fraction of a sample
        last = best[-1]
        return float(round(places[last] / period) / (places[last] * self.dt))

    @cached_property
    def _derivatives(self) -> tuple[FloatArray, FloatArray]:
        velocity = np.gradient(self.values, self.dt)
        acceleration = np.gradient(velocity, self.dt)
        for first, last in _pieces(self.values):
            ticks = np.arange(first, last + 1)
            if ticks.size < _SPLINE:
                continue
            # differences err by (w dt)^2 / 6, which an inverse of a mode multiplies
            curve = make_interp_spline(ticks * self.dt, self.values[first : last + 1], k=5)
            velocity[ticks], acceleration[ticks] = (
                curve.derivative(n)(ticks * self.dt) for n in (1, 2)
            )
        return velocity, acceleration

    def sample(self, time: FloatArray) -> Samples:
        """Return the waveform and its derivatives at `time` [s]."""
        time = np.asarray(time, np.float64)
        velocity, acceleration = self._derivatives
        place = np.clip(time / self.dt, 0.0, self.values.size - 1.0)
        ticks = np.arange(self.values.size)
        value, rate, curve = (
            np.interp(place, ticks, each) for each in (self.values, velocity, acceleration)
        )
        frequency = np.full(time.shape, self.frequency)
        return Samples(value, rate, curve, frequency, 2.0 * np.pi * frequency * time)


def _pieces(values: FloatArray) -> list[tuple[int, int]]:
    """Return first and last sample of each smooth part.

    At a corner the fourth difference is far above those on either side. One that lies between two
    samples belongs to neither part, nor does a jump: central differences remain there.
    """
    last = values.size - 1
    if values.size < _SPLINE:
        return []
    bend, turn = np.abs(np.diff(values, 4)), np.diff(values, 2)
    usual = np.maximum(median_filter(bend, 2 * _NEAR + 1), _ROUNDING * float(np.ptp(values)))
    turn = np.abs(turn - median_filter(turn, 2 * _NEAR + 1))
    sharp = np.flatnonzero(bend > _CORNER * usual) + 2  # of the middle sample
    pieces, begin = [], 0
    for group in np.split(sharp, np.flatnonzero(np.diff(sharp) > 1) + 1) if sharp.size else ():
        sizes = turn[group - 1]
        ends = group[sizes > _SHARE * sizes.max()]
        between = int(ends.size > 1)
        pieces.append((begin, int(ends[0]) - between))
        begin = int(ends[-1]) + between
    return [*pieces, (begin, last)]


def _summits(values: FloatArray, tops: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return place and height of the parabolas through local maxima and their neighbours."""
    left, middle, right = values[tops - 1], values[tops], values[tops + 1]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return tops + shift, middle - 0.25 * (left - right) * shift
