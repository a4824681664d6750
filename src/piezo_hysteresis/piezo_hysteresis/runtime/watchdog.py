"""Brings the voltage of a link to safety when its input stays away."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.compensation.limiter import Limiter


@dataclass
class Watchdog:
    """Counts the ticks of the actuator without a command from this link.

    Time is that of the actuator: in lock-step it stops while a command is missing, so that slow
    processes do not trigger the watchdog.
    """

    limiter: Limiter  # limiter of the link; its voltage is ramped
    timeout: int  # ticks without a command before the ramp starts; 0 disables it
    safe_voltage: float  # target voltage [V]
    ramp: float  # rate [V/s]
    stale: bool = False  # whether the input is missing
    episodes: int = 0  # number of timeouts
    newest: int = -1  # newest tick with a command, -1 before the first
    _arrived: bool = False

    def received(self, sample: int) -> None:
        """Record the command for tick `sample`."""
        self.newest = sample
        self.stale = self._arrived = False

    def reset(self) -> None:
        """Wait for the first command again."""
        self.newest = -1
        self.stale = self._arrived = False

    def voltage(self, tick: int) -> float | None:
        """Return the command for `tick` [V], None if there is none to publish.

        The link stops publishing once it has reached the safe voltage: the receiving node then
        detects the broken chain and applies its own safe voltage.
        """
        if not self.overdue(tick) or self._arrived:
            return None
        if not self.stale:
            self.stale = True
            self.episodes += 1
        limits = self.limiter.limits
        voltage = self.limiter.ramp_to(self.safe_voltage, self.ramp)
        self._arrived = voltage == min(max(self.safe_voltage, limits.low), limits.high)
        return voltage

    def overdue(self, tick: int) -> bool:
        """Return whether `tick` comes too late after the newest command."""
        return 0 < self.timeout < tick - self.newest and self.newest >= 0
