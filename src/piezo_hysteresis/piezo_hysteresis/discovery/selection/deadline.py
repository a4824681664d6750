"""When a search ends, and what it then had no time for."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import inf

from piezo_hysteresis.errors import IdentificationError


@dataclass
class Deadline:
    """A limit of time that a search asks before it begins anything new.

    Attributes
    ----------
    seconds : float
        From now; without end where not given [s].
    untried : dict of str to None
        What was skipped, in the order in which it came up.

    Raises
    ------
    IdentificationError
        If there is no time at all.
    """

    seconds: float = inf
    untried: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin to count."""
        if not self.seconds > 0.0:
            raise IdentificationError(
                'the time limit must be more than 0 s; leave it out for none'
            )
        self._end = time.monotonic() + self.seconds

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self._end

    def skips(self, what: str) -> bool:
        """Return whether there is no time for something, and take note of it."""
        late = self.passed
        if late:
            self.untried[what] = None
        return late
