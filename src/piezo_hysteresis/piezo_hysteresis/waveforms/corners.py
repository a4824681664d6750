"""Signals made of straight lines: triangles, staircases, steps, reversal curves, rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.waveform import Samples, Shape, Shaped, WaveformError


@dataclass(frozen=True)
class Triangle(Shaped):
    """A triangle that starts at its middle and rises; the voltage rate is ``4 a f``.

    Attributes
    ----------
    frequency : float
        Frequency [Hz].
    phase : float
        Phase at time 0 [rad]; -pi/2 starts at the lower corner.
    """

    frequency: float = 1.0
    phase: float = 0.0

    def shape(self, time: FloatArray) -> Shape:
        """Return the triangle between -1 and 1."""
        turn = np.mod(self.frequency * time + self.phase / (2.0 * np.pi) + 0.25, 1.0)
        rising = turn < 0.5
        value = np.where(rising, 4.0 * turn - 1.0, 3.0 - 4.0 * turn)
        rate = np.where(rising, 4.0, -4.0) * self.frequency
        return value, rate, np.zeros_like(time)

    def fundamental(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return frequency and phase of the fundamental."""
        return (
            np.full_like(time, self.frequency),
            2.0 * np.pi * self.frequency * time + self.phase,
        )


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
