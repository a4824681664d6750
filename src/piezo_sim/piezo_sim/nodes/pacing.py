"""When a simulated tick is due, and which command it gets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

COUNTS = (
    'late', 'missed', 'refused', 'doubled', 'timeouts', 'overruns', 'slew_limited', 'stamp_jumps',
)  # fmt: skip

# A command this many ticks ahead of the next one is meant for another run of the loop.
AHEAD = 1000
# Of a command at the slew, which is no breach of it.
_ROUNDING = 1e-9


@dataclass
class CommandQueue:
    """The commands that arrived and what became of them.

    Attributes
    ----------
    low, high : float
        Range of commands that are accepted [V].
    safe_voltage : float
        Where the voltage goes when commands stay away [V].
    ramp : float
        How fast it goes there [V/s].
    slew : float
        Fastest change of the command that is applied [V/s].
    timeout : float
        A command this many ticks late is counted and not applied: what it was meant for is over.
    wanted : float
        The newest command [V].
    voltage : float
        The command that is applied [V].
    timed_out : bool
        The commands stay away.
    counts : dict of str to int
        What happened so far, by the names of `COUNTS`.
    """

    low: float
    high: float
    safe_voltage: float = 0.0
    ramp: float = 1.0
    slew: float = math.inf
    timeout: float = math.inf
    wanted: float = 0.0
    voltage: float = 0.0
    timed_out: bool = False
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTS, 0))
    _newest: int = -1
    _received: int = -1

    def accept(self, voltage: float) -> bool:
        """Take `voltage` as the newest command, or refuse and count it."""
        if not math.isfinite(voltage) or not self.low <= voltage <= self.high:
            self.counts['refused'] += 1
            return False
        self.wanted = voltage
        return True

    def follow(self, dt: float) -> None:
        """Apply the newest command for the next tick, no faster than the slew."""
        away, step = self.wanted - self.voltage, self.slew * dt
        if abs(away) > step * (1.0 + _ROUNDING):
            self.voltage += math.copysign(step, away)
            self.counts['slew_limited'] += 1
        else:
            self.voltage = self.wanted

    def rest(self) -> None:
        """Be at 0 V at once."""
        self.wanted = self.voltage = 0.0

    def arrive(self, sample: int, voltage: float, tick: int) -> bool:
        """Take a command for tick `sample`, while `tick` is the next to be simulated.

        Its value may be refused; False is returned where its number already tells that it is none
        of the loop.
        """
        if sample <= self._newest:
            self.counts['doubled'] += 1
            return False
        if sample > tick + AHEAD:
            self.counts['refused'] += 1
            return False
        self._newest = sample
        self.counts['late'] += sample < tick
        if tick - sample <= self.timeout and self.accept(voltage):
            self._received = tick
        return True

    def hold(self, tick: int, dt: float, timeout: float) -> None:
        """Hold the command for `tick`, or after `timeout` seconds of silence ramp it to safety.

        A tick without its command is missed; once the commands are taken to have ended, none is.
        """
        silence = (tick - self._received) * dt
        self.timed_out = silence > timeout
        if self.timed_out:
            self.counts['timeouts'] += self._newest >= 0 and silence - dt <= timeout
            step = min(self.ramp, self.slew) * dt
            away = self.safe_voltage - self.voltage
            self.wanted = self.voltage + max(-step, min(step, away))
        elif 0 <= self._newest < tick:
            self.counts['missed'] += 1
        self.follow(dt)

    @property
    def received(self) -> bool:
        """Whether a command was ever taken."""
        return self._newest >= 0


@dataclass
class Pace:
    """Which ticks are due by now, for a clock that runs `speed_factor` times real time."""

    rate: float
    speed_factor: float = 1.0
    _origin: float = 0.0
    _origin_tick: int = 0

    def restart(self, now: float, tick: int) -> None:
        """Let `tick` be due at `now` [s]."""
        self._origin, self._origin_tick = now, tick

    def due(self, now: float) -> int:
        """Return the number of the newest tick that is due at `now` [s]."""
        elapsed = (now - self._origin) * self.rate * self.speed_factor
        return self._origin_tick + math.floor(elapsed)

    @property
    def interval(self) -> float:
        """Real time between two ticks [s]."""
        return 1.0 / (self.rate * self.speed_factor)
