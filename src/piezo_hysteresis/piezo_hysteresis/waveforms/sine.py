"""Waveforms by formulas: sines, and lines with smooth or sharp corners."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from math import gcd

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
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
            f'a multisine of {counted(count, "line")} cannot be made; choose `highest` within '
            '1 .. 1e5 times '
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


# Share of a period by which a time may miss a corner that it is meant to hit: rounding must not
# decide on which side of the corner a sample lies.
_AT_CORNER = 1e-9


@dataclass(frozen=True)
class Raster(Shaped):
    """The fast axis of a scan: a trace, a retrace, and a turn-around at either end.

    The trace rises at a constant rate from the lower corner to the upper one, the retrace falls.
    Within a turn-around the acceleration is a raised cosine, so that the motion stays smooth; the
    straight parts lie on the lines through the corners at -1 and 1. It starts in the middle of the
    trace. Without a turn-around the corners are sharp.

    Attributes
    ----------
    frequency : float
        Lines per second, each with trace and retrace [Hz].
    phase : float
        Phase at time 0 [rad]; -pi times `trace` starts at the lower corner.
    trace : float
        Share of the period for the trace, 0..1; 0.5 is a triangle, 0.9 a saw tooth whose flyback
        takes a tenth of the period.
    turn : float
        Share of the period for each turn-around; at most the shorter of trace and retrace.
    """

    frequency: float = 1.0
    phase: float = 0.0
    trace: float = 0.5
    turn: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.trace < 1.0:
            raise WaveformError(f'the trace takes a share of the period, got {self.trace:g}')
        if not 0.0 <= self.turn <= min(self.trace, 1.0 - self.trace) + _AT_CORNER:
            raise WaveformError(
                f'a turn-around of {self.turn:g} periods does not fit between trace and retrace: '
                f'it lasts at most {min(self.trace, 1.0 - self.trace):g}'
            )

    def shape(self, time: FloatArray) -> Shape:
        """Return the scan between -1 and 1."""
        turn = np.mod(self.frequency * time + self.phase / (2.0 * np.pi) + 0.5 * self.trace, 1.0)
        turn = np.where(turn >= 1.0 - _AT_CORNER, 0.0, turn)
        rising = turn < self.trace - _AT_CORNER
        up, down = 2.0 / self.trace, -2.0 / (1.0 - self.trace)
        value = np.where(rising, up * turn - 1.0, 1.0 + down * (turn - self.trace))
        rate, bend = np.where(rising, up, down), np.zeros_like(turn)
        if self.turn > 0.0:
            for corner, change in ((0.0, up - down), (self.trace, down - up)):
                after = np.mod(turn - corner + 0.5, 1.0) - 0.5
                near = np.abs(after) < 0.5 * self.turn
                x = after / self.turn
                later = after >= -_AT_CORNER
                wave = 2.0 * np.pi * x
                swept = 0.5 * (x + 0.5) ** 2 - (np.cos(wave) + 1.0) / (4.0 * np.pi**2)
                swept = self.turn * (swept - np.where(later, x, 0.0))
                share = x + 0.5 + np.sin(wave) / (2.0 * np.pi) - later
                value = value + np.where(near, change * swept, 0.0)
                rate = rate + np.where(near, change * share, 0.0)
                bend = bend + np.where(near, change * (1.0 + np.cos(wave)) / self.turn, 0.0)
        return value, rate * self.frequency, bend * self.frequency**2

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return frequency and phase of the fundamental."""
        return (
            np.full_like(time, self.frequency),
            2.0 * np.pi * self.frequency * time + self.phase,
        )


class Triangle(Raster):
    """A raster whose trace and retrace last the same; the voltage rate is ``4 a f``."""


@dataclass(frozen=True)
class Lines:
    """Straight lines between corners; two corners at one time make a jump.

    Attributes
    ----------
    times : tuple of float
        Times of the corners [s], not falling, from 0 on.
    values : tuple of float
        Values there, in the unit of the signal. The last is held.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values) or not self.times:
            raise WaveformError('straight lines need as many times as values, at least one')
        if self.times[0] != 0.0 or any(np.diff(self.times) < 0.0):
            raise WaveformError('the times of the corners must start at 0 and not fall')

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.times[-1]

    def sample(self, time: FloatArray) -> Samples:
        """Return the lines at `time` [s]; at a corner what follows it."""
        time = np.asarray(time, dtype=np.float64)
        corners, levels = np.array(self.times), np.array(self.values)
        after = np.searchsorted(corners, time, side='right')
        left = np.clip(after - 1, 0, corners.size - 1)
        right = np.clip(after, 0, corners.size - 1)
        width = corners[right] - corners[left]
        inside = width > 0.0
        slope = np.where(inside, levels[right] - levels[left], 0.0)
        slope = slope / np.where(inside, width, 1.0)
        nothing = np.zeros_like(time)
        return Samples(
            value=levels[left] + slope * (time - corners[left]),
            velocity=slope,
            acceleration=nothing,
            frequency=nothing.copy(),
            phase=nothing.copy(),
        )


def rest(duration: float, level: float = 0.0) -> Lines:
    """Return `duration` [s] of a constant `level`: shows drift, hum and noise alone."""
    return Lines((0.0, duration), (level, level))


def step_and_hold(
    amplitude: float, duration: float, delay: float = 0.5, offset: float = 0.0
) -> Lines:
    """Return a step to `offset` + `amplitude` at `delay` [s], held to the end: shows creep."""
    if not 0.0 <= delay < duration:
        raise WaveformError(f'the step at {delay:g} s lies outside the {duration:g} s of the run')
    high = offset + amplitude
    return Lines((0.0, delay, delay, duration), (offset, offset, high, high))


def staircase(
    amplitude: float, steps: int, hold: float, rise: float = 0.0, offset: float = 0.0
) -> Lines:
    """Return stairs from `offset` up to +amplitude, down to -amplitude and back.

    Every step is held for `hold` [s] and reached within `rise` [s] of it.
    """
    if not 0.0 <= rise <= hold:
        raise WaveformError(f'a rise of {rise:g} s does not fit into steps of {hold:g} s')
    up = [amplitude * k / steps for k in range(1, steps + 1)]
    levels = [*up, *up[-2::-1], 0.0, *(-v for v in up), *(-v for v in up[-2::-1]), 0.0]
    times, values, now = [0.0, hold], [offset, offset], hold
    for level in levels:
        times += [now + rise, now + hold]
        values += [offset + level] * 2
        now += hold
    return Lines(tuple(times), tuple(values))


def reversal_curves(amplitude: float, curves: int, rate: float, offset: float = 0.0) -> Lines:
    """Return first-order reversal curves between -amplitude and +amplitude.

    From the upper end down to one of `curves` reversal points and up again, at the constant `rate`
    [unit/s]; the points come nearer from curve to curve. They show nonlocal memory.
    """
    points = [amplitude, -amplitude, amplitude]
    for k in range(1, curves + 1):
        points += [amplitude - 2.0 * amplitude * (curves - k + 1) / (curves + 1), amplitude]
    return _along([0.0, *points, 0.0], rate, offset)


def _along(points: Iterable[float], rate: float, offset: float) -> Lines:
    """Return straight lines through `points` at a constant `rate` [unit/s]."""
    values = np.array(list(points))
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)) / rate)])
    return Lines(tuple(map(float, times)), tuple(map(float, offset + values)))
