"""Sample numbers and times of messages: order, gaps, repetitions, restarts and stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

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


NANOSECONDS = 1_000_000_000

# Permitted deviation of a stamp from the index: clock adjustment or jitter [ns].
TOLERANCE = NANOSECONDS // 2


def stamp_into(stamp: Time, nanoseconds: int) -> None:
    """Write `nanoseconds` since the epoch into `stamp`."""
    stamp.sec, stamp.nanosec = divmod(nanoseconds, NANOSECONDS)


def nanoseconds_of(stamp: Time) -> int:
    """Return `stamp` in nanoseconds since the epoch."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def tick_nanoseconds(sample: int, rate: float) -> int:
    """Return the time of tick `sample` at `rate` [Hz], in nanoseconds from tick 0."""
    return round(sample * NANOSECONDS / rate)


class StampValidator:
    """Validates time stamps by the sample indices."""

    def __init__(self, dt: float) -> None:  # dt [s]
        self.jumps = 0
        self._step = dt * NANOSECONDS
        self._sample = -1
        self._stamped = 0  # stamp of the newest sample
        self._time = 0  # accepted time

    def begin(self) -> None:
        """Accept the stamp of the next sample for any index."""
        self._sample = -1

    def true_time(self, sample: int, nanoseconds: int) -> int:
        """Return the time of `sample` with the stamp `nanoseconds` [ns].

        A single inconsistent stamp is replaced by the time from the index; a changed clock is
        accepted from the next sample on. Samples must be in order. A source without stamps sends
        0, which is no jump.
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


class ActuatorClock:
    """Converts ticks to actuator time, so that markers cut records at the correct samples.

    The time of a simulator follows its ticks; a driver may use any clock.
    """

    def __init__(self, rate: float) -> None:  # rate [Hz]
        self._rate = rate
        self._stamps = StampValidator(1.0 / rate)
        self._offset = 0
        self._early = 0

    @property
    def jumps(self) -> int:
        """Number of states whose stamp did not follow from the previous one."""
        return self._stamps.jumps

    def update(self, sample: int, nanoseconds: int) -> None:
        """Update the clock: the state of tick `sample` has the stamp `nanoseconds` [ns]."""
        true = self._stamps.true_time(sample, nanoseconds)
        if not true:
            return  # the first tick of a simulator, or a source that does not stamp
        offset = true - tick_nanoseconds(sample, self._rate)
        if offset != self._offset:
            if self._offset:
                # It jitters: between two ticks an edge is on the right side of both.
                self._early = round(0.5 * NANOSECONDS / self._rate)
            self._offset = offset

    def time_of(self, sample: int) -> int:
        """Return the time of tick `sample` [ns]."""
        return max(0, tick_nanoseconds(sample, self._rate) + self._offset)

    def edge_at(self, sample: int) -> int:
        """Return a time that the states from tick `sample` on have reached, none before [ns]."""
        return max(0, self.time_of(sample) - self._early)
