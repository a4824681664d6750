"""When a simulated tick is due, and which command it gets; knows no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass
class CommandBook:
    """The commands that arrived and what became of them.

    Attributes
    ----------
    low, high : float
        Range of commands that are accepted [V].
    safe_voltage : float
        Where the voltage goes when commands stay away [V].
    ramp : float
        How fast it goes there [V/s].
    """

    low: float
    high: float
    safe_voltage: float = 0.0
    ramp: float = 1.0
    voltage: float = 0.0
    counts: dict[str, int] = field(
        default_factory=lambda: {'late': 0, 'missed': 0, 'refused': 0, 'doubled': 0}
    )

    def accept(self, voltage: float) -> bool:
        """Take `voltage` as the newest command, or refuse and count it."""
        if not math.isfinite(voltage) or not self.low <= voltage <= self.high:
            self.counts['refused'] += 1
            return False
        self.voltage = voltage
        return True

    def ramp_to_safe(self, dt: float) -> None:
        """Move the held voltage one interval of `dt` seconds towards the safe voltage."""
        step = self.ramp * dt
        away = self.safe_voltage - self.voltage
        self.voltage += max(-step, min(step, away))


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
