"""Commands that move an actuator no faster than it is allowed, however late they come.

An actuator that keeps its own pace holds what it has where a command comes late. The next one,
made for its tick as planned, would move it by all that was missed at once. So a command is held
to what the actuator says that it applies, and to every command since then: each of them may still
be the one before it, or be skipped.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

# Commands that are remembered; more are on their way where nothing answers any more.
_ON_THEIR_WAY = 256
# A command has arrived after so long, and acts or was skipped [s].
_ARRIVES = 0.1
# An actuator that stands still for so long does not wait for commands, it ignores them [s].
_STUCK = 1.0
_ROUNDING = 1e-9


class _Sent(NamedTuple):
    """A command [V], for which tick, and when it was sent [s]."""

    voltage: float
    sample: int
    time: float


class SteadyCommand:
    """Bounds the change of a command by a rate, from wherever the actuator may be.

    Commands that are applied in their tick may move by the rate. One that is always a tick late
    has two of them to be near to, and so moves half as fast.

    Parameters
    ----------
    rate : float
        Ticks per second [Hz].
    now : callable
        Clock [s].

    Attributes
    ----------
    eased : int
        Commands that were held back.
    behind : bool
        Whether the last command was not the one that was planned.
    """

    def __init__(self, rate: float, now: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._now, self._still = rate, now, 0
        self._applied: float | None = None
        self._sent: deque[_Sent] = deque(maxlen=_ON_THEIR_WAY)
        self.limited = 0
        self.behind = False

    def reset(self) -> None:
        """Begin again with an actuator that was started anew."""
        self._applied, self._still, self.behind = None, 0, False
        self._sent.clear()

    def update(self, sample: int, voltage: float) -> None:
        """Note what was applied at a tick [V]: what was sent before that is over."""
        if voltage == self._applied:  # held: nothing more is known of what is on its way
            self._still += self.behind
        else:
            self._still, self._applied = 0, voltage
            if any(each.voltage == voltage for each in self._sent):
                while self._sent.popleft().voltage != voltage:  # the oldest that it may be
                    pass
            else:  # an actuator that goes its own way
                while len(self._sent) > 1:
                    self._sent.popleft()
        self._drop_arrived(sample)

    def _drop_arrived(self, sample: int) -> None:
        """Drop commands that had come before tick `sample`, as the last states have reported them.

        What was sent long ago is over only where that tick was long after it, too: states may
        have waited to be heard.
        """
        arrived, ticks = self._now() - _ARRIVES, _ARRIVES * self._rate
        while len(self._sent) > 1:
            first = self._sent[0]
            if first.time > arrived or sample < first.sample + ticks:
                break
            self._sent.popleft()

    def next(self, sample: int, planned: float, slew: float) -> float:
        """Return the command of a tick [V] for what is planned [V].

        It moves the actuator by no more than `slew` [V/s]; 0 is any.
        """
        command = planned
        if slew > 0.0 and self._applied is not None and self._still <= _STUCK * self._rate:
            most = slew / self._rate * (1.0 + _ROUNDING)
            before = (self._applied, *(each.voltage for each in self._sent))
            low, high = max(before) - most, min(before) + most
            if low > high:  # it went its own way meanwhile
                low, high = self._applied - most, self._applied + most
            command = min(max(planned, low), high)
        self.behind = command != planned
        self.limited += self.behind
        if not self._sent or self._sent[-1].voltage != command:
            self._sent.append(_Sent(command, sample, self._now()))
        return command
