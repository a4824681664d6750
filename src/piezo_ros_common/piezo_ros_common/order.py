"""What the number of a sample says about the one who counts them; knows no ROS."""

# Messages of one writer come in order; further back than this it was started anew.
REORDERED = 64

# One message that is further ahead than this is a stray; the next one confirms a jump.
AHEAD = 1000

COUNTS = ('missed', 'doubled', 'reordered', 'strays')


def started_anew(sample: int, newest: int) -> bool:
    """Tell whether a source that was at `newest` has been restarted, now that `sample` comes."""
    return sample < newest and (sample == 0 or newest - sample > REORDERED)


class Intake:
    """Judges the numbers of one stream of messages and counts what is wrong with them.

    Attributes
    ----------
    newest : int
        Number of the newest message that was taken, -1 before the first.
    """

    def __init__(self) -> None:
        self.newest = -1
        self._stray = -1
        self._counts = dict.fromkeys(COUNTS, 0)

    def take(self, sample: int) -> bool:
        """Return whether the message `sample` is to be used; it then is the newest."""
        newest = self.newest
        if sample == newest + 1 or newest < 0:
            self.newest = sample
            self._stray = -REORDERED  # a jump is confirmed only by the very next message
            return True
        if sample <= newest:
            if started_anew(sample, newest):
                self.newest = sample
                return True
            self._counts['doubled' if sample == newest else 'reordered'] += 1
            return False
        if sample > newest + AHEAD and not 0 <= sample - self._stray <= REORDERED:
            self._stray = sample
            self._counts['strays'] += 1
            return False
        self._counts['missed'] += sample - newest - 1
        self.newest = sample
        return True

    def counters(self) -> dict[str, int]:
        """Return what happened so far, by the names of `COUNTS`."""
        return dict(self._counts)
