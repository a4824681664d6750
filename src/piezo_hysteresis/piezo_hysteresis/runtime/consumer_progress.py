"""Progress report of a sample consumer.

A node that takes samples in tells on its latched ``~/status`` by these names how many it has
taken, so that a player knows how far its listeners are.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

TAKEN, MARKED = 'taken', 'marked'


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
        """Whether it is a recorder."""
        return self.takes and 'written' in self.counts

    @property
    def taken(self) -> int:
        """Samples that it has taken, -1 where it does not tell."""
        return self.counts.get(TAKEN, -1)

    @property
    def marked(self) -> int:
        """Markers that it has taken, -1 where it does not tell."""
        return self.counts.get(MARKED, -1)
