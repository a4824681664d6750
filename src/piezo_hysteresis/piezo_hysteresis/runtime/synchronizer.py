"""Synchronizes the messages of each tick, independent of their order of arrival."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

from piezo_hysteresis.compensation.link import Measured, ReferencePoint

Tag = TypeVar('Tag')

# A tick this much older than the newest voltage is processed incomplete (only in real time: in
# lock-step the next voltage arrives only after the previous one was processed).
TIMEOUT = 2

# Largest number of stored messages, also if no voltage arrives.
LONGEST = 5000


class Tick(NamedTuple, Generic[Tag]):
    """All inputs of a link for one tick."""

    point: ReferencePoint  # the reference of the tick
    received: float  # the voltage from the previous link [V]
    measured: Measured | None  # the measurement of the previous tick
    tag: Tag  # data attached to the voltage


class SampleSynchronizer(Generic[Tag]):
    """Buffers early messages until their tick is complete.

    Tick k is complete with its reference, its voltage and the measurement of tick k - 1 (for
    k = 0 without). A link thus computes the same numbers for every order of arrival.
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
        """Index of the newest processed tick."""
        return self._done

    @property
    def waiting(self) -> int:
        """Number of buffered messages."""
        return len(self._points) + len(self._voltages) + len(self._measured)

    def add_reference(self, point: ReferencePoint) -> None:
        """Add the reference of a tick."""
        if point.sample > self._done:
            self._points[point.sample] = point
            self._points.pop(point.sample - LONGEST, None)

    def add_measured(self, measured: Measured) -> None:
        """Add the measurement of a tick."""
        if self._newest_measured is None or measured.sample > self._newest_measured.sample:
            self._newest_measured = measured
        if measured.sample >= self._done:
            self._measured[measured.sample] = measured
            self._measured.pop(measured.sample - LONGEST, None)

    def add_voltage(self, sample: int, voltage: float, tag: Tag) -> bool:
        """Add the voltage of a tick; return False if it is old or a duplicate.

        A duplicate voltage means that the loop waits. Its tick is then processed with the
        available inputs, so that a link that started late does not block the loop.
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
        """Return and remove the oldest complete tick, or None.

        A voltage without a reference is dropped once newer voltages have arrived.
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
        for book, last in (
            (self._points, sample), (self._voltages, sample), (self._measured, sample - 1)
        ):  # fmt: skip
            book.pop(last, None)
            if book and min(book) < last:
                for old in [each for each in book if each < last]:
                    del book[old]
