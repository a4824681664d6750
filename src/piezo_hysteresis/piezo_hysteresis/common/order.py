"""Filter of sample numbers: order, gaps, repetitions and restarts."""

# Messages of one writer arrive in order; a larger backward step means a restart.
REORDERED = 64

COUNTS = ('missed', 'doubled', 'reordered', 'strays')

# No number follows this one.
_NONE = -REORDERED - 1


class SequenceFilter:
    """Checks the indices of a stream of messages and counts errors.

    An index that does not follow the newest one is accepted once the next message confirms it,
    whatever its distance: a real gap costs one more message, a stray is never used. An index of 0
    means a restart and is accepted immediately.
    """

    def __init__(self, *, restarts: bool = True) -> None:
        self.newest = -1
        self._restarts = restarts
        self._outlier = _NONE
        self._counts = dict.fromkeys(COUNTS, 0)

    def take(self, sample: int) -> bool:
        """Return whether the message `sample` is accepted; it then is the newest."""
        newest = self.newest
        if sample == newest + 1 and self._outlier == _NONE:  # as nearly always
            self.newest = sample
            return True
        follows = newest < 0 or sample == newest + 1
        begins = sample == 0 and self._restarts
        if not follows and newest - REORDERED <= sample <= newest and (not newest or not begins):
            self._counts['doubled' if sample == newest else 'reordered'] += 1
            return False
        # A jump is confirmed only by the very next message; without it, it was a stray.
        confirms = 0 <= sample - self._outlier <= REORDERED
        self._counts['strays'] += self._outlier != _NONE and not confirms
        if not (follows or begins or confirms):
            self._outlier = sample
            return False
        if 0 <= newest < sample:
            self._counts['missed'] += sample - newest - 1
        self.newest, self._outlier = sample, _NONE
        return True

    def counters(self) -> dict[str, int]:
        """Return the counters by the names of `COUNTS`."""
        return dict(self._counts)
