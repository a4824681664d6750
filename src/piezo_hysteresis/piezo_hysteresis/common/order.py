"""Filter of sample numbers, and check of stamps against them."""

from piezo_hysteresis.common.stamps import NANOSECONDS

# Messages of one writer come in order; further back than this it was started anew.
REORDERED = 64

# One message that is further ahead than this is a stray; the next one confirms a jump.
AHEAD = 1000

COUNTS = ('missed', 'doubled', 'reordered', 'strays')

# No number follows this one.
_NONE = -REORDERED - 1

# Stamps may differ from what the numbers say by this: a clock that is set right, or jitter [ns].
TOLERANCE = NANOSECONDS // 2


class SequenceFilter:
    """Judges the numbers of one stream of messages and counts what is wrong with them.

    A number far from the others is believed once the next message confirms it. A source that
    begins at 0 was started anew, and is believed at once.

    Parameters
    ----------
    anew : bool
        False where somebody else tells that the source was started anew: then 0 is a number like
        all others.

    Attributes
    ----------
    newest : int
        Number of the newest message that was taken, -1 before the first.
    """

    def __init__(self, *, restarts: bool = True) -> None:
        self.newest = -1
        self._restarts = restarts
        self._outlier = _NONE
        self._counts = dict.fromkeys(COUNTS, 0)

    def take(self, sample: int) -> bool:
        """Return whether the message `sample` is to be used; it then is the newest."""
        newest = self.newest
        if sample == newest + 1 or newest < 0:
            return self._taken(sample)
        if newest - REORDERED <= sample <= newest and (sample or not newest or not self._restarts):
            self._counts['doubled' if sample == newest else 'reordered'] += 1
            return False
        begins = sample == 0 and self._restarts
        far = sample < newest or sample > newest + AHEAD
        if far and not begins and not 0 <= sample - self._outlier <= REORDERED:
            self._outlier = sample
            self._counts['strays'] += 1
            return False
        if sample > newest:
            self._counts['missed'] += sample - newest - 1
        return self._taken(sample)

    def _taken(self, sample: int) -> bool:
        self.newest = sample
        self._outlier = _NONE  # a jump is confirmed only by the very next message
        return True

    def counters(self) -> dict[str, int]:
        """Return what happened so far, by the names of `COUNTS`."""
        return dict(self._counts)


class StampValidator:
    """Holds time stamps against the numbers of samples, which are the truth.

    Parameters
    ----------
    dt : float
        Time between two samples [s].

    Attributes
    ----------
    jumps : int
        How often the time of a sample did not follow from that of the one before.
    """

    def __init__(self, dt: float) -> None:
        self.jumps = 0
        self._step = dt * NANOSECONDS
        self._sample = -1
        self._stamped = 0  # what the newest sample said
        self._time = 0  # what it is taken for

    def begin(self) -> None:
        """Believe the stamp of the next sample, whatever its number."""
        self._sample = -1

    def true_time(self, sample: int, nanoseconds: int) -> int:
        """Return the time of `sample`, where it says `nanoseconds` [ns].

        One stamp that does not follow from those before is replaced by what the number says; a
        clock that was set is believed from the next sample on. Samples must come in order. A
        source that stamps nothing says 0, and that is no jump.
        """
        gained = round((sample - self._sample) * self._step)
        moved = nanoseconds - self._stamped
        follows = moved > 0 and abs(moved - gained) <= TOLERANCE
        begins = self._sample < 0 or gained <= 0
        if begins or follows or not (nanoseconds or self._time):
            true = nanoseconds
        else:
            self.jumps += 1
            true = self._time + gained
        self._sample, self._stamped, self._time = sample, nanoseconds, true
        return true
