"""Which sample of which waveform a tick gets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.numerics.smooth import smooth_ramp
from piezo_hysteresis.waveforms import Sine, Waveform
from piezo_hysteresis.waveforms.waveform import Samples

# Ticks that are evaluated together, and to see how far a waveform goes.
AHEAD = 256
LOOKED_AT = 100_000


def extremes(waveform: Waveform, rate: float) -> tuple[float, float]:
    """Return minimum and maximum of a waveform, in its unit."""
    ticks = min(waveform.duration * rate, LOOKED_AT)
    value = waveform.sample(np.arange(max(1, round(ticks)), dtype=np.float64) / rate).value
    return float(np.min(value)), float(np.max(value))


@dataclass(frozen=True)
class Delayed:
    """A waveform that begins `delay` seconds later."""

    waveform: Waveform
    delay: float

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.delay + self.waveform.duration

    def sample(self, time: FloatArray) -> Samples:
        """Return the waveform at `time` [s], any shape."""
        return self.waveform.sample(time - self.delay)


@dataclass(frozen=True)
class Blend:
    """One waveform going over into another: value, velocity and acceleration are continuous."""

    old: Waveform
    new: Waveform
    start: float  # when the change begins [s]
    length: float  # how long it takes [s]

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.new.duration

    def sample(self, time: FloatArray) -> Samples:
        """Return the waveform at `time` [s], any shape."""
        a, b = self.old.sample(time), self.new.sample(time)
        share, rate, bend = smooth_ramp(time - self.start, self.length)
        a = _replaced(a, b, share >= 1.0)  # the old one is over, whatever it was
        gap, gap_rate = b.value - a.value, b.velocity - a.velocity
        gap_acceleration = b.acceleration - a.acceleration
        return Samples(
            value=a.value + share * gap,
            velocity=a.velocity + rate * gap + share * gap_rate,
            acceleration=a.acceleration
            + bend * gap
            + 2.0 * rate * gap_rate
            + share * gap_acceleration,
            frequency=b.frequency,
            phase=b.phase,
        )


def _replaced(old: Samples, new: Samples, where: BoolArray) -> Samples:
    """Return the old samples, and the new ones `where` those do not count or are no numbers."""
    finite = np.isfinite(old.value) & np.isfinite(old.velocity) & np.isfinite(old.acceleration)
    chosen = where | ~finite
    return replace(
        old,
        value=np.where(chosen, new.value, old.value),
        velocity=np.where(chosen, new.velocity, old.velocity),
        acceleration=np.where(chosen, new.acceleration, old.acceleration),
    )


@dataclass
class Experiment:
    """One waveform laid over the ticks of the loop."""

    waveform: Waveform  # pure function of the time since `first`
    first: int  # tick at which it starts
    rate: float  # sampling rate [Hz]
    length: int = 0  # ticks it lasts; 0 has no end
    _ahead_from: int = field(default=0, init=False, repr=False)
    _ahead: list[tuple[float, ...]] = field(default_factory=list, init=False, repr=False)

    def over(self, sample: int) -> bool:
        """Return whether `sample` is after the end."""
        return self.length > 0 and sample - self.first >= self.length

    def point(self, sample: int) -> ReferencePoint:
        """Return the waveform at tick `sample`, in its unit."""
        place = sample - self._ahead_from
        if not 0 <= place < len(self._ahead):
            self._look_ahead(sample)
            place = 0
        return ReferencePoint(sample, *self._ahead[place])

    def _look_ahead(self, sample: int) -> None:
        """Evaluate many ticks together: arrays of one element cost as much as long ones."""
        ticks = np.arange(sample - self.first, sample - self.first + AHEAD, dtype=np.float64)
        s = self.waveform.sample(ticks * (1.0 / self.rate))
        columns = (s.value, s.velocity, s.acceleration, s.frequency, s.phase)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        self._ahead_from, self._ahead = sample, list(rows)

    def change(self, waveform: Waveform, sample: int, length: float) -> None:
        """Go over to `waveform` from tick `sample` on, within `length` seconds.

        A sinusoid that follows another keeps the phase; everything else begins at its start.
        """
        now = self._time(sample)
        old = self._settled(now)
        if isinstance(old, Sine) and isinstance(waveform, Sine):
            turned = 2.0 * math.pi * (old.frequency - waveform.frequency) * now
            new: Waveform = replace(waveform, phase=old.phase + turned)
        else:
            new = Delayed(waveform, now)
        self.waveform = Blend(old, new, now, length)
        self._ahead = []

    def _time(self, sample: int) -> float:
        return (sample - self.first) * (1.0 / self.rate)

    def _settled(self, now: float) -> Waveform:
        """Return the waveform without transitions that are complete at `now`."""
        waveform = self.waveform
        if isinstance(waveform, Blend) and now >= waveform.start + waveform.length:
            return waveform.new
        return waveform
