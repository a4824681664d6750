"""Progress report of a sample consumer.

A node that consumes samples reports their count on its latched ``~/status`` by these names, so
that a player knows the progress of its subscribers.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

TAKEN, MARKED = 'taken', 'marked'


@dataclass
class Progress:
    """Progress reported by a node."""

    counts: Mapping[str, int] = field(default_factory=dict)  # counts by name
    received: bool = False  # whether a report was received
    first: int = 0  # samples consumed before counting started

    def receive(self, names: Collection[str], values: Collection[int]) -> None:
        """Store the `names` and `values` of a status."""
        self.counts = dict(zip(names, map(int, values), strict=False))
        self.received = True

    @property
    def takes(self) -> bool:
        """Whether the node consumes samples."""
        return TAKEN in self.counts

    @property
    def keeps(self) -> bool:
        """Whether it is a recorder."""
        return self.takes and 'written' in self.counts

    @property
    def taken(self) -> int:
        """Number of consumed samples, -1 if unknown."""
        return self.counts.get(TAKEN, -1)

    @property
    def marked(self) -> int:
        """Number of consumed markers, -1 if unknown."""
        return self.counts.get(MARKED, -1)
