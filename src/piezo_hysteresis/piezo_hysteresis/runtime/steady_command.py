"""Commands that never move an actuator faster than was planned, however late they come.

An actuator that keeps its own pace holds what it has where a command comes late. The next one,
made for its tick as planned, would move it by all that was missed at once. So what the actuator
says that it applied counts, and what was missed is caught up with at the pace of the plan.
"""

from __future__ import annotations

# How much one tick counts in the share of those that were answered in time, and from which share
# on an actuator is taken to apply commands in their tick, and to say what it applied.
_WEIGHT, _PROMPT = 0.05, 0.5
_ROUNDING = 1e-9
# One that stands still for so long does not wait for commands any more, it ignores them [s].
_STUCK = 1.0


class SteadyCommand:
    """Bounds the change of a command by what was planned, from where the actuator is.

    An actuator that always answers a tick later, or that tells a measured voltage and not the
    command, misses nothing by that: what it says is not built upon.

    Parameters
    ----------
    rate : float
        Ticks per second [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._patience, self._still = rate * _STUCK, 0
        self._sample, self._sent = -1, 0.0
        self._heard, self._applied = -1, 0.0
        self._planned: float | None = None
        self._fastest = 0.0
        self._prompt = 0.0
        #: Commands that were held back.
        self.eased = 0

    def begin(self) -> None:
        """Begin with another plan."""
        self._planned, self._fastest = None, 0.0

    def forget(self) -> None:
        """Begin again with an actuator that was started anew."""
        self.begin()
        self._sample = self._heard = -1

    @property
    def behind(self) -> bool:
        """Whether the last command was not the one that was planned."""
        return self._planned is not None and self._sent != self._planned

    def hear(self, sample: int, voltage: float) -> None:
        """Note what was applied at a tick [V]; one that was held says nothing of who is prompt."""
        stands = voltage == self._applied
        if sample == self._sample and not stands:
            self._prompt += _WEIGHT * (float(voltage == self._sent) - self._prompt)
        self._still = self._still + 1 if stands and voltage != self._sent else 0
        if self._still > self._patience:
            self._prompt = 0.0
        self._heard, self._applied = sample, voltage

    def next(self, sample: int, planned: float) -> float:
        """Return the command of tick `sample` [V] for what is planned for it [V]."""
        command = planned
        if self._planned is not None:
            ticks = max(1, sample - self._sample)
            self._fastest = max(self._fastest, abs(planned - self._planned) / ticks)
            known = self._heard == sample - 1 and self._prompt > _PROMPT
            at = self._applied if known else self._sent
            if known and abs(planned - at) > self._fastest * (1.0 + _ROUNDING):
                command = at + (self._fastest if planned > at else -self._fastest)
                self.eased += 1
        self._sample, self._sent, self._planned = sample, command, planned
        return command
