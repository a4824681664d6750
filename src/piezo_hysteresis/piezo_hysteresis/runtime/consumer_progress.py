"""Progress report of a sample consumer.

A node that takes them in tells on its latched ``~/status`` by these names what it has taken. A
recorder tells besides what it holds: from which sample to which it missed none, and the stamp of
its newest marker. So the node that drives an experiment knows which recorder holds each record.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

TAKEN, MARKED, SINCE, NEWEST, EDGE = 'taken', 'marked', 'since', 'newest', 'edge'

# Places, not amounts: of use to other nodes only.
PLACES = (SINCE, NEWEST, EDGE)


@dataclass
class Taken:
    """What a recorder has taken, as it tells it.

    Attributes
    ----------
    taken, marked : int
        Samples and markers.
    since, newest : int
        First and last number of the newest samples of which none is missing, -1 for none;
        `since` lies behind `newest` where that one had to be dropped.
    edge : int
        Stamp of the newest marker [ns], -1 for none.
    """

    taken: int = 0
    marked: int = 0
    since: int = -1
    newest: int = -1
    edge: int = -1

    def state(self, sample: int, kept: bool = True) -> None:
        """Count the state of tick `sample`; `kept` is False where it had to be dropped."""
        if not kept:
            self.since, self.newest = sample + 1, sample
            return
        self.taken += 1
        if sample == self.newest:
            return  # it came twice
        if sample != self.newest + 1 or self.newest < 0:
            self.since = sample
        self.newest = sample

    def marker(self, nanoseconds: int, kept: bool = True) -> None:
        """Count a marker stamped `nanoseconds`."""
        if kept:
            self.marked += 1
            self.edge = nanoseconds

    def counts(self) -> dict[str, int]:
        """Return what is reported, by name."""
        reported = {TAKEN: self.taken, MARKED: self.marked}
        if self.newest >= 0:
            reported |= {SINCE: self.since, NEWEST: self.newest}
        if self.edge >= 0:
            reported[EDGE] = self.edge
        return reported


@dataclass
class Progress:
    """What a node has reported.

    Attributes
    ----------
    counts : mapping of str to int
        By name.
    received : bool
        Whether it has reported anything at all.
    first : int
        Samples that it had taken when counting began.
    """

    counts: Mapping[str, int] = field(default_factory=dict)
    received: bool = False
    first: int = 0

    def receive(self, names: Collection[str], values: Collection[int]) -> None:
        """Take in the `names` and `values` of a status."""
        self.counts = dict(zip(names, map(int, values), strict=False))
        self.received = True

    @property
    def takes(self) -> bool:
        """Whether it is one that takes samples in."""
        return TAKEN in self.counts

    @property
    def keeps(self) -> bool:
        """Whether it is a recorder of samples and markers, which must not miss one."""
        return self.takes and 'written' in self.counts

    @property
    def taken(self) -> int:
        """Samples that it has taken, -1 where it does not tell."""
        return self.counts.get(TAKEN, -1)

    @property
    def marked(self) -> int:
        """Markers that it has taken, -1 where it does not tell."""
        return self.counts.get(MARKED, -1)

    @property
    def edge(self) -> int:
        """Stamp of its newest marker [ns], -1 for none."""
        return self.counts.get(EDGE, -1)

    def holds(self, first: int, last: int) -> bool | None:
        """Return whether it has the samples `first` to `last`, False where one is missing.

        None says that they are not all there yet.
        """
        since, newest = self.counts.get(SINCE, -1), self.counts.get(NEWEST, -1)
        if newest < last:
            return None
        return since <= first
