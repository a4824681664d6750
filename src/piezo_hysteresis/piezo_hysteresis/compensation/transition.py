"""From one law to another without a jump: the difference is faded out smoothly."""

from __future__ import annotations

import math

# The steepest slope of the quintic smooth step of unit height and length.
_STEEPEST = 1.875


def smooth_step(s: float) -> tuple[float, float, float]:
    """Answer the quintic smooth step at `s` in 0..1 and its first two derivatives."""
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


class Transition:
    """Bumpless change: holds what the output would have jumped by and lets it fade.

    A step in the voltage strikes a lightly damped mode, so the difference fades along a quintic
    smooth step, whose velocity and acceleration are continuous.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    duration : float
        Seconds that a change takes [s].
    slew : float
        Largest rate at which the difference may fade [V/s]; a large one takes longer.
    """

    def __init__(self, dt: float, duration: float = 0.2, slew: float = math.inf) -> None:
        self._dt = dt
        self._duration = duration
        self._slew = slew
        self._pending = False
        self._bump = 0.0
        self._elapsed = 0
        self._length = dt
        self._last: float | None = None

    def start(self) -> None:
        """Make the next output begin where the last one was."""
        self._pending = self._last is not None

    def retune(self, duration: float, slew: float) -> None:
        """Change how long [s] and how fast [V/s] changes may be, from the next one on."""
        self._duration, self._slew = duration, slew

    def apply(self, raw: float) -> float:
        """Answer the output for this tick [V]; `raw` is what the law in charge wants."""
        if self._pending and self._last is not None:
            self._pending = False
            self._bump = self._last - raw
            self._elapsed = 0
            self._length = max(self._duration, self._dt, _STEEPEST * abs(self._bump) / self._slew)
        output = raw
        if self._bump != 0.0:
            done = self._elapsed * self._dt / self._length
            if done >= 1.0:
                self._bump = 0.0
            else:
                output += self._bump * (1.0 - smooth_step(done)[0])
                self._elapsed += 1
        self._last = output
        return output

    @property
    def active(self) -> bool:
        """Whether a change is under way."""
        return self._pending or self._bump != 0.0

    def reset(self) -> None:
        """Forget the last output and any change under way."""
        self._pending = False
        self._bump = 0.0
        self._last = None
