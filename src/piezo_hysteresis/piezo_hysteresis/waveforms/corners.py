"""Signals made of straight lines: triangles, staircases, steps, reversal curves, rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.waveform import Samples, Shape, Shaped, WaveformError

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
