"""A sweep as it runs: no record counts before every recorder has confirmed it.

In lock-step the loop stands still while a recorder is waited for. An actuator that keeps its own
pace rests meanwhile: there the marker of a record is sent some ticks ahead.
"""

from __future__ import annotations

import enum
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from piezo_hysteresis.records.markers import CANCELLED, MOVED, REPEATED
from piezo_hysteresis.runtime.consumer_progress import Progress
from piezo_hysteresis.runtime.sweep_plan import Sweep, SweepRecord

# How far ahead the marker of a record is sent to an actuator that keeps its own pace, at first and
# at most: twice as far each time that somebody did not confirm it in time [s].
LEAD, LONGEST_LEAD = 0.05, 1.0

# How often one record is run again for somebody who missed some of it, or came in its middle.
MOST_REPEATS = 3


class Pause(enum.Enum):
    """What stands in place of a voltage."""

    HOLD = 'the tick waits for a recorder'
    OVER = 'the sweep is over'


class Audience(Protocol):
    """Whom the markers of a sweep are for."""

    def mark(self, record: SweepRecord, sample: int) -> int:
        """Say that a record begins at tick `sample`; return the stamp of the marker [ns]."""

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Say that a record ends at tick `sample`, or that `judged` does not count and why.

        Returns the stamp of the marker [ns].
        """

    def keepers(self) -> Mapping[str, Progress]:
        """Return what the recorders have reported, by name."""

    @property
    def edge_at(self) -> Callable[[int], int]:
        """Returns the stamp of a marker at a tick [ns]."""


@dataclass(frozen=True)
class Running:
    """A record and who records it.

    Attributes
    ----------
    record : SweepRecord
        Which.
    first : int
        Tick of the loop at which it begins.
    stamp : int
        Stamp of its newest marker [ns].
    names : frozenset of str
        Recorders that take it.
    """

    record: SweepRecord
    first: int
    stamp: int
    names: frozenset[str]

    @property
    def last(self) -> int:
        """Tick behind its end."""
        return self.first + self.record.voltages.size


@dataclass(frozen=True)
class Kept:
    """A record that counts, by name, its last tick, and who confirmed to have all of it."""

    name: str
    last: int
    by: tuple[str, ...]


class SweepRun:
    """What each tick of a sweep gets.

    Parameters
    ----------
    sweep : Sweep
        The plan; its first tick is known.
    audience : Audience
        Whom the markers are for.

    Attributes
    ----------
    paced : bool
        The actuator keeps its own pace.
    kept : list of Kept
        Records that count so far.
    awaited : str
        Who has to confirm what; empty for nobody.
    since : float
        Since when that is awaited [s], on the monotonic clock.
    """

    def __init__(self, sweep: Sweep, audience: Audience) -> None:
        self.sweep = sweep
        self.paced = False
        self.kept: list[Kept] = []
        self.awaited = ''
        self.since = 0.0
        self._audience = audience
        self._asked: Running | None = None
        self._open: Running | None = None
        self._closed: Running | None = None
        self._lead = LEAD
        self._repeats: Counter[int] = Counter()

    def step(self, sample: int) -> float | Pause:
        """Return the voltage of tick `sample` [V], or why it gets none."""
        sweep = self.sweep
        if sweep.over(sample) or sweep.starting(sample) is not None:
            pause = self._between(sample)
            if pause is not None:
                return pause
        elif self._open is not None:
            if sweep.ending(sample):
                self._close(self._open, sample)
            elif self._newcomers(self._open):
                self._again(self._open, sample, max(sweep.gap, sweep.way_back))
        return sweep.voltage(sample)

    def stop(self, sample: int, why: str = CANCELLED) -> None:
        """Return to rest from tick `sample` on; the record that runs does not count."""
        self.sweep.cancel(sample)
        closed, current = self._closed, self._open or self._asked
        self._closed = self._open = self._asked = None
        self._await(())
        if closed is not None:
            self._count(closed, [name for name, has in self._reported(closed).items() if has])
        if current is not None:
            self._audience.end(current.record.name, why, sample)

    def take_back(self, since: int, sample: int, why: str) -> None:
        """Do not count the records that had ticks from `since` on, after all."""
        for record in [record for record in self.kept if record.last > since]:
            self.kept.remove(record)
            self._audience.end(record.name, why, sample)

    # --- between two records -------------------------------------------------------------------

    def _between(self, sample: int) -> Pause | None:
        """Judge the record before and let the next begin; None where the tick has a voltage."""
        sweep = self.sweep
        judged = self._judged(sample)
        record = sweep.starting(sample)
        if record is None:
            return Pause.OVER if judged else Pause.HOLD
        if judged and self._begin(record, sample):
            return None
        if not self.paced:
            return Pause.HOLD
        if sweep.starting(sample) is not None:
            sweep.rest(sample, 1, record)
        return None

    def _judged(self, sample: int) -> bool:
        """Return whether it is known who has the record before; let it be repeated if need be."""
        closed = self._closed
        if closed is None:
            return True
        reported = self._reported(closed)
        late = [name for name, has in reported.items() if has is None]
        if late:
            self._await(late, f'the end of record {closed.record.name}')
            return False
        self._closed = None
        self._await(())
        if not all(reported.values()) and self._repeatable(closed):
            self._again(closed, sample, 0)
        else:
            self._count(closed, [name for name, has in reported.items() if has])
        return True

    def _reported(self, closed: Running) -> dict[str, bool | None]:
        """Return for each recorder that is still there whether it has all of a record."""
        keepers = self._audience.keepers()
        known = {name: keepers[name] for name in sorted(closed.names & keepers.keys())}
        return {
            name: each.holds(closed.first, closed.last - 1) if each.edge == closed.stamp else None
            for name, each in known.items()
        }

    def _begin(self, record: SweepRecord, sample: int) -> bool:
        """Return whether every recorder knows that the record begins; ask those who do not."""
        asked = self._asked
        if asked is None or asked.record is not record or asked.first != sample:
            asked = self._ask(record, sample)
            if asked.first != sample:
                return False
        keepers = self._audience.keepers()
        late = [name for name, known in keepers.items() if known.edge != asked.stamp]
        if not late:
            self._open = replace(asked, names=frozenset(keepers))
            if self._audience.edge_at(sample) != asked.stamp:
                self._ask(record, sample, lead=0)  # the clock of the actuator went on otherwise
            self._asked = None
            self._await(())
            return True
        self._await(late, f'the marker of record {record.name}')
        if self.paced:
            self._lead = min(2.0 * self._lead, LONGEST_LEAD)
            self._ask(record, sample)
        elif not asked.names.issuperset(late):
            self._ask(record, sample)  # somebody came after it was said
        return False

    def _ask(self, record: SweepRecord, sample: int, lead: int | None = None) -> Running:
        """Say that a record begins: now, or soon where the actuator does not wait."""
        names = frozenset(self._audience.keepers())
        if lead is None:
            lead = max(1, round(self._lead * self.sweep.rate)) if self.paced and names else 0
        if self._asked is not None and self._audience.edge_at(sample + lead) != self._asked.stamp:
            self._audience.end(self._asked.record.name, MOVED, sample)
        if lead:
            self.sweep.rest(sample, lead, record)
        stamp = self._audience.mark(record, sample + lead)
        self._asked = Running(record, sample + lead, stamp, names)
        return self._asked

    # --- records -------------------------------------------------------------------------------

    def _close(self, record: Running, sample: int) -> None:
        stamp = self._audience.end('', '', sample)
        self._open, self._closed = None, replace(record, stamp=stamp)

    def _newcomers(self, record: Running) -> bool:
        return not record.names.issuperset(self._audience.keepers()) and self._repeatable(record)

    def _repeatable(self, record: Running) -> bool:
        return self._repeats[record.record.first] < MOST_REPEATS

    def _again(self, record: Running, sample: int, ticks: int) -> None:
        """Run a record once more, so that every recorder has all of it."""
        self._repeats[record.record.first] += 1
        self._open = None
        self._audience.end(record.record.name, REPEATED, sample)
        self.sweep.rest(sample, ticks, record.record)

    def _count(self, record: Running, by: Iterable[str]) -> None:
        self.kept.append(Kept(record.record.name, record.last, tuple(by)))

    def _await(self, names: Iterable[str], what: str = '') -> None:
        awaited = f'{", ".join(names)} to confirm {what}' if what else ''
        if bool(awaited) != bool(self.awaited):
            self.since = time.monotonic()
        self.awaited = awaited


def kept_message(kept: Iterable[Kept]) -> str:
    """Return how many records there are and who recorded them, in one sentence."""
    records = list(kept)
    count = f'{len(records)} record{"" if len(records) == 1 else "s"}'
    if not records:
        return count
    if len({record.by for record in records}) == 1:
        by = ', '.join(records[0].by)
        return f'{count}, recorded by {by}' if by else f'{count}, confirmed by no recorder'
    each = (f'{record.name} by {", ".join(record.by) or "nobody"}' for record in records)
    return f'{count}: {", ".join(each)}'
