"""The clock of the actuator, estimated from the stamps of its states."""

from __future__ import annotations

from piezo_hysteresis.common.order import StampValidator
from piezo_hysteresis.common.stamps import NANOSECONDS, tick_nanoseconds


class ActuatorClock:
    """Converts ticks to actuator time, so that markers cut records at the correct samples.

    The time of a simulator follows its ticks; a driver may use any clock.

    Parameters
    ----------
    rate : float
        Sampling rate [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._stamps = StampValidator(1.0 / rate)
        self._offset = 0
        self._early = 0

    @property
    def jumps(self) -> int:
        """How often the stamp of a state did not follow from the one before."""
        return self._stamps.jumps

    def update(self, sample: int, nanoseconds: int) -> None:
        """Update the clock: the state of tick `sample` has the stamp `nanoseconds` [ns]."""
        true = self._stamps.true_time(sample, nanoseconds)
        if not true:
            return  # the first tick of a simulator, or a source that does not stamp
        offset = true - tick_nanoseconds(sample, self._rate)
        if offset != self._offset:
            if self._offset:
                # It jitters: between two ticks an edge is on the right side of both.
                self._early = round(0.5 * NANOSECONDS / self._rate)
            self._offset = offset

    def time_of(self, sample: int) -> int:
        """Return the time of tick `sample` [ns]."""
        return max(0, tick_nanoseconds(sample, self._rate) + self._offset)

    def edge_at(self, sample: int) -> int:
        """Return a time that the states from tick `sample` on have reached, none before [ns]."""
        return max(0, self.time_of(sample) - self._early)
