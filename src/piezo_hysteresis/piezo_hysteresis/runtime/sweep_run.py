"""A sweep as it runs, tick by tick: its markers, and which of its records count."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.records.markers import CANCELLED, FAILED, REPEATED
from piezo_hysteresis.runtime.sweep_plan import Sweep, SweepRecord

# Messages of a sweep whose actuator restarts or stops: a client can start the sweep again.
ACTUATOR_RESTARTED = 'the actuator was restarted during the sweep; run it again'
NOT_RUNNING = 'the actuator or a link of the chain is not running; start it and set mode again'

# Largest number of repetitions of a record with a lost state.
MOST_REPEATS = 3


class Markers(Protocol):
    """Publishes, and records, where records begin and end."""

    def mark(self, record: SweepRecord, sample: int) -> None:
        """Mark that a record begins at tick `sample`."""

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Mark the end of a record at tick `sample`, or reject the record `judged` and why.

        Return the number of messages that the recording has accepted so far.
        """


@dataclass(frozen=True)
class Running:
    """A record, the tick of the loop at which it begins, and its last message in the bag."""

    record: SweepRecord
    first: int
    queued: int = 0

    @property
    def last(self) -> int:
        """Tick behind its end."""
        return self.first + self.record.voltages.size


class SweepRun:
    """Voltages and markers of a running sweep."""

    def __init__(self, sweep: Sweep, markers: Markers, *, recorded: bool = False) -> None:
        self.sweep = sweep
        self.kept: list[Running] = []
        self._markers = markers
        self._recorded = recorded
        self._open: Running | None = None
        self._closed: tuple[Running, bool] | None = None  # and whether it is complete
        self._repeats: Counter[int] = Counter()
        self._stepped: int | None = None
        # the newest complete run of states: `_since` to `_newest`
        self._since, self._newest = 0, -1
        # the voltage of the newest state, and the tick at which it changed last
        self._voltage, self._moved = math.nan, -1
        self.unmoved: list[str] = []

    def add_state(self, sample: int, voltage: float, *, kept: bool = True) -> None:
        """Add the state of tick `sample`; it is in the bag unless it was dropped."""
        if voltage != self._voltage:
            self._voltage, self._moved = voltage, sample
        if not kept:
            self._since = sample + 1
        elif sample != self._newest + 1:
            self._since = sample
        self._newest = sample

    def step(self, sample: int) -> float | None:
        """Return the voltage of tick `sample` [V], None after the end of the sweep."""
        sweep = self.sweep
        if self._stepped is not None and sample > self._stepped + 1:
            self._catch_up(self._stepped, sample)
        self._stepped = sample
        if sweep.over(sample) or sweep.starting(sample) is not None:
            self._judge(sample)
            record = sweep.starting(sample)
            if record is not None:
                self._open = Running(record, sample)
                self._markers.mark(record, sample)
            elif sweep.over(sample):
                return None
        elif self._open is not None and sweep.ending(sample):
            queued = self._markers.end('', '', sample)
            self._closed = (replace(self._open, queued=queued), self._is_whole(self._open))
            self._open = None
        return sweep.voltage(sample)

    def stop(self, sample: int, why: str = CANCELLED) -> None:
        """Return to rest from tick `sample` on; the record that runs does not count."""
        self.sweep.cancel(sample)
        closed, current = self._closed, self._open
        self._closed = self._open = None
        if closed is not None and closed[1]:
            self.kept.append(closed[0])
        if current is not None:
            self._markers.end(current.record.name, why, sample)

    def take_back(self, since: int, sample: int, why: str) -> None:
        """Do not count the records that had ticks from `since` on, after all."""
        for each in [each for each in self.kept if each.last > since]:
            self.kept.remove(each)
            self._markers.end(each.record.name, why, sample)

    def drop_unwritten(self, written: int) -> list[str]:
        """Do not count records beyond the `written` messages of the bag; return their names."""
        lost = [each for each in self.kept if each.queued > written]
        self.kept = [each for each in self.kept if each.queued <= written]
        return [each.record.name for each in lost]

    def _catch_up(self, last: int, sample: int) -> None:
        """Run the first record again that began or ended between ticks `last` and `sample`."""
        way_back = self.sweep.way_back
        if self._open is not None and sample > self._open.last:
            queued = self._markers.end('', '', sample)
            self._closed = (replace(self._open, queued=queued), self._is_whole(self._open))
            self._open = None
            if self._judge(sample, way_back, last):
                return
        for tick in range(last + 1, min(sample, last + 1 + self.sweep.length)):
            record = self.sweep.starting(tick)
            if record is not None and self._repeats[record.first] < MOST_REPEATS:
                self._repeats[record.first] += 1
                self.sweep.rest(sample, way_back, record, last)
                return

    def _judge(self, sample: int, ticks: int = 0, since: int | None = None) -> bool:
        """Accept the previous record, or repeat it in `ticks` if samples were lost.

        Return whether it is repeated.
        """
        if self._closed is None:
            return False
        (closed, is_whole), self._closed = self._closed, None
        if is_whole:
            self.kept.append(closed)
        elif self._repeats[closed.record.first] < MOST_REPEATS:
            self._repeats[closed.record.first] += 1
            self._markers.end(closed.record.name, REPEATED, sample)
            self.sweep.rest(sample, ticks, closed.record, since)
            return True
        else:
            self._markers.end(closed.record.name, FAILED, sample)
            if not self._has_moved(closed):
                self.unmoved.append(closed.record.name)
        return False

    def _is_whole(self, record: Running) -> bool:
        held = self._since <= record.first and self._newest >= record.last - 1
        return (held or not self._recorded) and self._has_moved(record)

    def _has_moved(self, record: Running) -> bool:
        """Return whether the actuator changed its voltage in a record that asks for it."""
        return self._moved > record.first or not np.ptp(record.record.voltages)


def kept_message(run: SweepRun, bag: str = '') -> str:
    """Return how many records of a sweep there are, where, and which were lost and why."""
    names = [each.record.name for each in run.kept]
    lost = [each.name for each in run.sweep.records if each.name not in (*names, *run.unmoved)]
    message = counted(len(names), 'record')
    message += f' in {bag}' if bag else ''
    message += f'; states of {", ".join(lost)} were lost' if lost else ''
    if run.unmoved:
        message += (
            f'; in {", ".join(run.unmoved)} the actuator did not change its voltage: check that '
            'it takes voltage/command'
        )
    return message
