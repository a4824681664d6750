"""Time limit of a search and list of the skipped steps."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import inf

from piezo_hysteresis.errors import IdentificationError


@dataclass
class Deadline:
    """A time limit that a search checks before each new step.

    Attributes
    ----------
    seconds : float
        Time limit from now; unlimited by default [s].
    untried : dict of str to None
        Skipped steps, in the order of the search.

    Raises
    ------
    IdentificationError
        If the limit is no positive number.
    """

    seconds: float = inf
    untried: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start the clock."""
        if not (isinstance(self.seconds, (int, float)) and self.seconds > 0.0):
            raise IdentificationError(
                f'the time limit must be a number above 0 s, got {self.seconds!r}; leave it out '
                'for none'
            )
        self._end = time.monotonic() + self.seconds

    @property
    def passed(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() > self._end

    def skips(self, what: str) -> bool:
        """Return whether the time limit has passed, and record the skipped step."""
        late = self.passed
        if late:
            self.untried[what] = None
        return late
