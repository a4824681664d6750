"""From the last share of one law to the growing share of the next."""

from __future__ import annotations

from piezo_hysteresis.numerics.smooth import smooth_step


class CrossFade:
    """Fades the old share out and the new one in.

    A law that learns from the measurement answers wildly at first. It so begins with no weight,
    where `Transition` would pass its first answers on.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    duration : float
        Seconds that a change takes [s].
    """

    def __init__(self, dt: float, duration: float) -> None:
        self._dt = dt
        self._duration = duration
        self._elapsed: int | None = None
        self._from = 0.0
        self._last: float | None = None

    def start(self) -> None:
        """Make the next output begin where the last one was, if there was one."""
        if self._last is not None:
            self._from, self._elapsed = self._last, 0

    def retune(self, duration: float, _slew: float) -> None:
        """Change how long a change takes [s]; the slew is left to the limiter behind."""
        self._duration = duration

    def apply(self, raw: float) -> float:
        """Return the share for this tick [V]; `raw` is what the law in charge wants."""
        share = raw
        if self._elapsed is not None:
            done = self._elapsed * self._dt / max(self._duration, self._dt)
            share = self._from + smooth_step(done)[0] * (raw - self._from)
            self._elapsed = None if done >= 1.0 else self._elapsed + 1
        self._last = share
        return share
