"""Slew limit for commands that may arrive late.

A free-running actuator holds its voltage if a command is late. The next command, computed for its
own tick, would then cause a step of several ticks. A command is therefore limited relative to the
last applied voltage and to every command since: each of them may still be applied, or be skipped.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

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
