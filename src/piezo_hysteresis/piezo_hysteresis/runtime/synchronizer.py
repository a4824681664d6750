"""Brings together what belongs to one tick, in whatever order the messages come."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

from piezo_hysteresis.compensation.link import Measured, ReferencePoint

Tag = TypeVar('Tag')

# A tick this much older than the newest voltage is not waited for any longer (real time only: in
# lock-step the newest voltage cannot come before the older one was answered).
TIMEOUT = 2

# More than this is never kept, even where the voltage stays away for good.
LONGEST = 5000


class Tick(NamedTuple, Generic[Tag]):
    """Everything a link needs for one tick.

    Attributes
    ----------
    point : ReferencePoint
        The reference of the tick.
    received : float
        The voltage that came from the link before [V].
    measured : Measured or None
        The measurement of the tick before, or the newest one where that is lost.
    tag : object
        What came with the voltage.
    """

    point: ReferencePoint
    received: float
    measured: Measured | None
    tag: Tag


class SampleSynchronizer(Generic[Tag]):
    """Holds early messages back until their tick is complete.

    Tick k is complete with its reference, its voltage and the measurement of tick k - 1 (for
    k = 0 without). A link so computes the same numbers whatever the order of arrival.

    Attributes
    ----------
    dropped : int
        Voltages that were dropped because their reference never came.
    """

    def __init__(self) -> None:
        self._points: dict[int, ReferencePoint] = {}
        self._voltages: dict[int, tuple[float, Tag]] = {}
        self._measured: dict[int, Measured] = {}
        self._newest_measured: Measured | None = None
        self.dropped = 0
        self._done = -1
        self._repeated = -1

    @property
    def done(self) -> int:
        """Number of the newest tick that was taken."""
        return self._done

    @property
    def waiting(self) -> int:
        """How many messages wait for the rest of their tick."""
        return len(self._points) + len(self._voltages) + len(self._measured)

    def add_reference(self, point: ReferencePoint) -> None:
        """Note the reference of a tick."""
        if point.sample > self._done:
            self._points[point.sample] = point
            self._points.pop(point.sample - LONGEST, None)

    def add_measured(self, measured: Measured) -> None:
        """Note the measurement of a tick."""
        if self._newest_measured is None or measured.sample > self._newest_measured.sample:
            self._newest_measured = measured
        if measured.sample >= self._done:
            self._measured[measured.sample] = measured
            self._measured.pop(measured.sample - LONGEST, None)

    def add_voltage(self, sample: int, voltage: float, tag: Tag) -> bool:
        """Note the voltage of a tick; return False where it is old or came twice.

        That a voltage comes twice means that the loop waits: its tick is then answered with what
        there is, so that a link that started later than the others does not hold it up for ever.
        """
        if sample in self._voltages:
            self._repeated = sample
            return False
        if sample <= self._done:
            return False
        self._voltages[sample] = (voltage, tag)
        self._voltages.pop(sample - LONGEST, None)
        return True

    def take(self) -> Tick[Tag] | None:
        """Return the oldest tick that is complete, once, or None.

        A voltage whose reference never came is dropped once newer voltages are there.
        """
        while self._voltages:
            sample = min(self._voltages)
            waiting = max(self._voltages) - sample < TIMEOUT
            point = self._points.get(sample)
            if point is None:
                if waiting:
                    return None
                del self._voltages[sample]
                self.dropped += 1
                continue
            measured = self._measured.get(sample - 1)
            if measured is None and sample > 0 and waiting and sample != self._repeated:
                return None
            voltage, tag = self._voltages.pop(sample)
            self._discard(sample)
            return Tick(point, voltage, measured or self._newest_measured, tag)
        return None

    def _discard(self, sample: int) -> None:
        self._done = sample
        for book in (self._points, self._voltages):
            for old in [each for each in book if each <= sample]:
                del book[old]
        for old in [each for each in self._measured if each < sample]:
            del self._measured[old]
