"""Time limit of a search and list of the skipped steps."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from math import inf

from piezo_hysteresis.errors import IdentificationError

# Share of the time that a search leaves to the elimination. Chosen.
_RESERVED = 0.25


@dataclass
class Deadline:
    """A time limit that a search checks before each new step.

    The elimination of redundant effects is skipped last: until then an effect may be listed that a
    later one replaced.
    """

    seconds: float = inf  # time limit from `began`; unlimited by default [s]
    reserved: float = _RESERVED  # [1]
    began: float = field(default_factory=time.monotonic)  # monotonic time of the start [s]
    untried: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the limit."""
        if not (isinstance(self.seconds, (int, float)) and self.seconds > 0.0):
            raise IdentificationError(
                f'the time limit must be a number above 0 s, got {self.seconds!r}; leave it out '
                'for none'
            )

    @property
    def passed(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() - self.began > (1.0 - self.reserved) * self.seconds

    def with_reserve(self) -> Deadline:
        """Return the same limit with the time that is reserved for the elimination."""
        return replace(self, reserved=0.0)

    def skips(self, what: str) -> bool:
        """Return whether the time limit has passed, and record the skipped step."""
        late = self.passed
        if late:
            self.untried[what] = None
        return late
