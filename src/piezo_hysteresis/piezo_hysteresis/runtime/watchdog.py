"""Brings the voltage of a link to safety when its input stays away."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.compensation.limiter import Limiter


@dataclass
class Watchdog:
    """Counts the ticks that the actuator goes on without a command of this link.

    Time is that of the actuator: in lock-step it stands still while a command is missing, so that
    a loop of slow processes is never disturbed.

    Attributes
    ----------
    limiter : Limiter
        That of the link; its voltage is what is ramped.
    timeout : int
        Ticks without a command before the ramp begins; 0 is off.
    safe_voltage : float
        Where to go [V].
    ramp : float
        How fast [V/s].
    stale : bool
        The input stays away: the link ramps, or is silent at the safe voltage.
    episodes : int
        How often that happened.
    newest : int
        Newest tick for which a command was passed on, -1 before the first.
    """

    limiter: Limiter
    timeout: int
    safe_voltage: float
    ramp: float
    stale: bool = False
    episodes: int = 0
    newest: int = -1
    _arrived: bool = False

    def received(self, sample: int) -> None:
        """Take note that a command for tick `sample` was passed on."""
        self.newest = sample
        self.stale = self._arrived = False

    def reset(self) -> None:
        """Wait for the first command again."""
        self.newest = -1
        self.stale = self._arrived = False

    def voltage(self, tick: int) -> float | None:
        """Return what to command for `tick` [V], None where nothing is to be said.

        The link falls silent once it has said the safe voltage: the node that takes the commands
        then knows that the chain is broken, and keeps to its own safe voltage.
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
