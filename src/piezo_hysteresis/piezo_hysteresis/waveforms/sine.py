"""Sinusoids, Fujii 2018 (13), (24), Tatebatake 2017 (13), (15), sums of them, Zhou 2021 (9)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import gcd

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.smooth import smooth_ramp
from piezo_hysteresis.waveforms.waveform import Samples, Shape, Shaped, WaveformError

__all__ = ['Multisine', 'Sine', 'SineSum', 'common_frequency', 'smooth_ramp']

GRIDS = ('full', 'odd', 'odd_random')


@dataclass(frozen=True)
class Sine:
    """``offset + ramp(t) amplitude sin(2 pi frequency t + phase)``.

    Fujii 2018 (13), (24), Tatebatake 2017 (13), (15).

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
        """Return the sinusoid and its derivatives at `time` [s]."""
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


@dataclass(frozen=True)
class SineSum(Shaped):
    """``offset + ramp(t) amplitude sum(weights_i sin(2 pi frequencies_i t + phases_i))``.

    Zhou 2021 (9).

    Attributes
    ----------
    frequencies, weights, phases : tuple of float
        One entry per component: [Hz], [1] and [rad].
    """

    frequencies: tuple[float, ...] = ()
    weights: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.frequencies:
            raise WaveformError('a sum of sinusoids needs at least one frequency')
        for name in ('weights', 'phases'):
            if len(getattr(self, name)) != len(self.frequencies):
                raise WaveformError(
                    f'a sum of sinusoids needs as many {name} as frequencies, got '
                    f'{len(getattr(self, name))} and {len(self.frequencies)}'
                )

    def shape(self, time: FloatArray) -> Shape:
        """Return the sum for the amplitude 1."""
        value, rate, acceleration = (np.zeros_like(time) for _ in range(3))
        for f, weight, start in zip(self.frequencies, self.weights, self.phases, strict=True):
            omega = 2.0 * np.pi * f
            angle = omega * time + start
            sine = weight * np.sin(angle)
            value += sine
            rate += weight * omega * np.cos(angle)
            acceleration -= omega**2 * sine
        return value, rate, acceleration

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the greatest common divisor of the frequencies, and its phase."""
        f = common_frequency(self.frequencies)
        f = f if f * self.duration >= 1.0 else 0.0
        return np.full_like(time, f), 2.0 * np.pi * f * time


class Multisine(SineSum):
    """Harmonics of one frequency with equal amplitudes and random phases.

    Parameters
    ----------
    amplitude : float
        Peak of the signal, in its unit.
    frequency : float
        Fundamental, the distance of the lines [Hz].
    highest : float
        Highest line [Hz].
    duration : float
        Length [s]; whole periods make clean spectra.
    grid : str
        ``full``; ``odd`` leaves out the even lines, so that even distortions are seen there;
        ``odd_random`` leaves out one odd line of every four, too, where odd ones are seen.
    seed : int
        Seed of the phases and of the lines left out.
    offset, ramp : float
        As in `Shaped`.
    """

    def __init__(
        self,
        amplitude: float,
        frequency: float,
        highest: float,
        duration: float,
        grid: str = 'full',
        seed: int = 0,
        offset: float = 0.0,
        ramp: float = 0.0,
    ) -> None:
        rng = np.random.default_rng(seed)
        orders = multisine_orders(int(highest / frequency + 1e-9), grid, rng)
        phases = rng.uniform(0.0, 2.0 * np.pi, orders.size)
        size = 32 * int(orders[-1])  # fine enough for a peak within 0.5 %
        spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
        spectrum[orders] = -0.5j * size * np.exp(1j * phases)
        peak = float(np.abs(np.fft.irfft(spectrum, size)).max())
        super().__init__(
            amplitude=amplitude,
            duration=duration,
            offset=offset,
            ramp=ramp,
            frequencies=tuple(float(order * frequency) for order in orders),
            weights=(1.0 / peak,) * orders.size,
            phases=tuple(float(phase) for phase in phases),
        )


def multisine_orders(
    count: int, grid: str, rng: np.random.Generator
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the excited orders up to `count`, ascending."""
    if grid not in GRIDS:
        raise WaveformError(f'there is no grid {grid!r}; there are {", ".join(GRIDS)}')
    if not 1 <= count <= 100_000:
        raise WaveformError(
            f'a multisine of {count} lines cannot be made; choose `highest` within 1 .. 1e5 times '
            'the fundamental'
        )
    orders = np.arange(1, count + 1, 1 if grid == 'full' else 2)
    if grid == 'odd_random':
        groups = range(0, orders.size - 3, 4)
        out = [start + int(rng.integers(4)) for start in groups]
        orders = np.delete(orders, out)
    return orders


def common_frequency(frequencies: tuple[float, ...]) -> float:
    """Return the greatest common divisor of `frequencies` [Hz], resolved to 1 uHz."""
    numbers = [round(Fraction(f) * 1_000_000) for f in frequencies]
    return gcd(*numbers) / 1e6
