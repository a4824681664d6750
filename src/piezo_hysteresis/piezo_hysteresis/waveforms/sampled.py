"""A waveform given by its samples, such as a reference from a file or an array."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import median_filter

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.waveforms.waveform import Samples, WaveformError

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
