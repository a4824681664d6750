"""Time stamps from sample numbers: control never looks at the wall clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

NANOSECONDS = 1_000_000_000


def stamp_into(stamp: Time, nanoseconds: int) -> None:
    """Write `nanoseconds` since the epoch into `stamp`."""
    stamp.sec, stamp.nanosec = divmod(nanoseconds, NANOSECONDS)


def nanoseconds_of(stamp: Time) -> int:
    """Return `stamp` in nanoseconds since the epoch."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def tick_nanoseconds(sample: int, rate: float) -> int:
    """Return the time of tick `sample` at `rate` [Hz], in nanoseconds from tick 0."""
    return round(sample * NANOSECONDS / rate)
