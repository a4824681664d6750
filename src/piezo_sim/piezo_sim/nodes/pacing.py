"""Timing of simulated ticks, and selection of their commands."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge

COUNTS = (
    'late', 'missed', 'refused', 'doubled', 'timeouts', 'overruns', 'slew_limited', 'stamp_jumps',
)  # fmt: skip

# Relative rounding of a command at the slew rate limit that does not violate it.
_ROUNDING = 1e-9


@dataclass
class CommandQueue:
    """Received commands and the counts of their processing."""

    low: float  # [V]
    high: float  # [V]
    safe_voltage: float = 0.0  # target voltage if commands stop [V]
    ramp: float = 1.0  # rate of change to the safe voltage [V/s]
    slew: float = math.inf  # slew rate limit of the applied command [V/s]
    commanded_slew: float = math.inf  # that of the commanding node [V/s]
    timeout: float = math.inf
    wanted: float = 0.0  # latest command [V]
    voltage: float = 0.0  # applied command [V]
    timed_out: bool = False  # whether commands have stopped
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTS, 0))
    _newest: int = -1
    _received: int = -1

    def accept(self, voltage: float) -> bool:
        """Set `voltage` as the latest command, or reject and count it."""
        if not math.isfinite(voltage) or not self.low <= voltage <= self.high:
            self.counts['refused'] += 1
            return False
        self.wanted = voltage
        return True

    def limit(self, slew: float) -> bool:
        """Apply the slew limit of the commanding node [V/s]; return False if it is none."""
        if not 0.0 < slew < math.inf:
            self.counts['refused'] += 1
            return False
        self.commanded_slew = slew
        return True

    def follow(self, dt: float) -> None:
        """Apply the latest command to the next tick, within the slew rate limit."""
        away = self.wanted - self.voltage
        step = min(self.slew, self.commanded_slew) * dt
        if abs(away) > step * (1.0 + _ROUNDING):
            self.voltage += math.copysign(step, away)
            self.counts['slew_limited'] += 1
        else:
            self.voltage = self.wanted

    def rest(self) -> None:
        """Set the command to 0 V without a ramp."""
        self.wanted = self.voltage = 0.0

    def arrive(self, sample: int, voltage: float, tick: int) -> bool:
        """Process a command for tick `sample`; `tick` is the next simulated tick.

        Its value may be rejected. False is returned if its number does not belong to this run of
        the loop. A command for a later tick than the next one answers no state: it is a stray.
        """
        if sample <= self._newest:
            self.counts['doubled'] += 1
            return False
        if sample > tick:
            self.counts['refused'] += 1
            return False
        self._newest = sample
        self.counts['late'] += sample < tick
        if tick - sample <= self.timeout and self.accept(voltage):
            self._received = tick
        return True

    def hold(self, tick: int, dt: float, timeout: float) -> None:
        """Hold the command for `tick`.

        Ramp to the safe voltage after `timeout` seconds without one.

        A tick without its command counts as missed, until the commands are considered stopped.
        """
        silence = (tick - self._received) * dt
        self.timed_out = silence > timeout
        if self.timed_out:
            self.counts['timeouts'] += self._newest >= 0 and silence - dt <= timeout
            step = min(self.ramp, self.slew, self.commanded_slew) * dt
            away = self.safe_voltage - self.voltage
            self.wanted = self.voltage + max(-step, min(step, away))
        elif 0 <= self._newest < tick:
            self.counts['missed'] += 1
        self.follow(dt)

    @property
    def received(self) -> bool:
        """Whether a command was ever received."""
        return self._newest >= 0


@dataclass
class Pace:
    """Due ticks of a clock that runs at `speed_factor` times real time."""

    rate: float
    speed_factor: float = 1.0
    _origin: float = 0.0
    _origin_tick: int = 0

    def restart(self, now: float, tick: int) -> None:
        """Restart the clock so that `tick` is due at `now` [s]."""
        self._origin, self._origin_tick = now, tick

    def due(self, now: float) -> int:
        """Return the number of the latest tick that is due at `now` [s]."""
        elapsed = (now - self._origin) * self.rate * self.speed_factor
        return self._origin_tick + math.floor(elapsed)

    @property
    def interval(self) -> float:
        """Real time between two ticks [s]."""
        return 1.0 / (self.rate * self.speed_factor)


_SENTENCES: dict[str, Finding] = {
    'refused': (Level.WARN, 'commands are refused: not a number, beyond the range or far ahead'),
    'late': (Level.WARN, 'commands come after their tick: the machine or a link is too slow'),
    'missed': (Level.WARN, 'ticks had no command: the voltage before was held'),
    'overruns': (Level.WARN, 'ticks were late themselves: the machine is too slow'),
    'stamp_jumps': (Level.WARN, 'time stamps of commands jump: only their numbers count'),
    'slew_limited': (Level.WARN, 'commands jump or come late: they are slowed down to the slew'),
}


class ActuatorHealth:
    """Evaluates the health of a simulator; keeps track of counters that increased recently."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._watch = CounterWatch(_SENTENCES, now)

    def judge(
        self, books: Sequence[CommandQueue], tick: int, fault: str, waited: float, remark: str = ''
    ) -> Health:  # waited [s]
        """Return the health of an actuator, or of those of several axes with common counts."""
        counts = books[0].counts
        findings = self._watch.findings(counts)
        if fault != 'none':
            findings.append((Level.ERROR, f'fault {fault} is injected'))
        if any(book.timed_out and book.received for book in books):
            message = f'no commands: the voltage goes to {books[0].safe_voltage:g} V'
            findings.append((Level.ERROR, message))
        if waited > 0.0:
            findings.append((Level.WARN, f'no command for tick {tick} since {waited:.0f} s'))
        if remark:
            findings.append((Level.WARN, remark))
        several = len(books) > 1
        voltages = {
            f'voltage_{i}_V' if several else 'voltage_V': book.voltage
            for i, book in enumerate(books, 1)
        }
        values = {'sample': tick, **voltages, 'fault': fault, **counts}
        return judge(findings, 'runs' if tick else 'waits for the first command', values)
