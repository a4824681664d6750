"""Which sample of which waveform a tick gets."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.numerics.smooth import smooth_ramp
from piezo_hysteresis.waveforms import Sine, Waveform
from piezo_hysteresis.waveforms.waveform import Samples

# Largest number of commands in transit.
_ON_THEIR_WAY = 256
# After this time a command has been applied or skipped [s].
_ARRIVES = 0.1
# An actuator with a constant voltage for this time ignores commands [s].
_STUCK = 1.0
_ROUNDING = 1e-9


class _Sent(NamedTuple):
    """A command [V], for which tick, and when it was sent [s]."""

    voltage: float
    sample: int
    time: float


class SteadyCommand:
    """Limits the rate of a command relative to every possible state of the actuator.

    Commands that are applied in their own tick reach the full rate. A command that is always one
    tick late is limited relative to two voltages and reaches half the rate.
    """

    def __init__(self, rate: float, now: Callable[[], float] = time.monotonic) -> None:
        # rate [Hz]; now [s]
        self._rate, self._now, self._still = rate, now, 0
        self._applied: float | None = None
        self._sent: deque[_Sent] = deque(maxlen=_ON_THEIR_WAY)
        self.limited = 0
        self.behind = False

    def reset(self) -> None:
        """Reset for a restarted actuator."""
        self._applied, self._still, self.behind = None, 0, False
        self._sent.clear()

    def update(self, sample: int, voltage: float) -> None:
        """Store the voltage [V] applied at a tick; earlier commands are no longer in transit."""
        if voltage == self._applied:  # constant: no information on commands in transit
            self._still += self.behind
        else:
            self._still, self._applied = 0, voltage
            if any(each.voltage == voltage for each in self._sent):
                while self._sent.popleft().voltage != voltage:  # the oldest that it may be
                    pass
            else:  # the actuator changed the voltage itself
                while len(self._sent) > 1:
                    self._sent.popleft()
        self._drop_arrived(sample)

    def _drop_arrived(self, sample: int) -> None:
        """Discard commands that arrived before tick `sample` according to the last states.

        An old command is discarded only if the tick is also much later, because states may be
        delivered late.
        """
        arrived, ticks = self._now() - _ARRIVES, _ARRIVES * self._rate
        while len(self._sent) > 1:
            first = self._sent[0]
            if first.time > arrived or sample < first.sample + ticks:
                break
            self._sent.popleft()

    def next(self, sample: int, planned: float, slew: float) -> float:
        """Return the limited command of a tick [V] for the planned one [V].

        The actuator moves by no more than `slew` [V/s]; 0 means no limit.
        """
        command = planned
        if slew > 0.0 and self._applied is not None and self._still <= _STUCK * self._rate:
            most = slew / self._rate * (1.0 + _ROUNDING)
            before = (self._applied, *(each.voltage for each in self._sent))
            low, high = max(before) - most, min(before) + most
            if low > high:  # the actuator changed the voltage itself
                low, high = self._applied - most, self._applied + most
            command = min(max(planned, low), high)
        self.behind = command != planned
        self.limited += self.behind
        if not self._sent or self._sent[-1].voltage != command:
            self._sent.append(_Sent(command, sample, self._now()))
        return command


_SENTENCES: dict[str, Finding] = {
    'missed': (Level.WARN, 'ticks of the actuator were not received: they had no reference'),
    'strays': (Level.WARN, 'states are numbered far from the others: is there a second actuator?'),
    'reordered': (Level.WARN, 'states come out of order: is there a second actuator?'),
    'stamp_jumps': (Level.WARN, 'time stamps of states jump: the numbers of the samples hold'),
    'limited': (
        Level.WARN,
        'commands are held back to slew: they come late, or are planned faster',
    ),
    'restarts': (Level.WARN, 'the actuator was restarted'),
    'sweeps_refused': (Level.WARN, 'a sweep was refused'),
    'sweeps_failed': (Level.ERROR, 'a sweep did not come to its end'),
}

# Silence of the actuator that is reported during an experiment [s].
SILENCE = 2.0


@dataclass(frozen=True)
class Doing:
    """Present task of the node."""

    what: str  # the experiment or the record of a sweep; empty for none
    waits: str  # node that it waits for; empty for none
    given_up: str  # reason why the last experiment was aborted; empty if it was not
    silent: float  # time since the last actuator state [s]
    sample: int  # newest tick of the actuator, -1 for none


class ExcitationHealth:
    """Evaluates the health of an excitation, including recently increased counters."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._watch = CounterWatch(_SENTENCES, now)

    def judge(self, doing: Doing, counts: Mapping[str, int], last: str) -> Health:
        """Return the health for the task `doing`; `last` is the outcome of the last sweep."""
        findings = self._watch.findings(counts)
        if doing.given_up:
            findings.append((Level.ERROR, doing.given_up))
        if doing.waits:
            findings.append((Level.WARN, f'waits for {doing.waits}'))
        elif doing.what and doing.silent > SILENCE:
            message = f'no actuator/state for {doing.silent:.0f} s after tick {doing.sample}'
            findings.append((Level.WARN, message))
        rest = 'idle' if doing.sample >= 0 else 'idle, no actuator state received yet'
        values = {'sample': doing.sample, 'last_sweep': last, **counts}
        return judge(findings, doing.what or rest, values)


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
