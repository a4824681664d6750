"""Tells a plant that answers with the opposite sign from one that is merely driven too hard."""

from __future__ import annotations

# Slower than the swings of an unstable loop about a resonance, faster than drift.
_SMOOTHING = 0.1
_MEMORY = 2.0


class PolarityWatch:
    """Correlates slow changes of voltage and displacement.

    The sign alone proves nothing: feedback that fights a disturbance moves against it. Ask only
    when the loop has run into a limit.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    """

    def __init__(self, dt: float) -> None:
        self._share = min(1.0, dt / _SMOOTHING)
        self._forget = min(1.0, dt / _MEMORY)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._started = False
        self._slow_v = self._slow_y = 0.0
        self._first_v = self._first_y = 0.0
        self._product = 0.0

    def see(self, voltage: float, displacement: float) -> None:
        """Take the voltage [V] and the displacement [m] of one tick."""
        if not self._started:
            self._started = True
            self._slow_v = self._first_v = voltage
            self._slow_y = self._first_y = displacement
        self._slow_v += self._share * (voltage - self._slow_v)
        self._slow_y += self._share * (displacement - self._slow_y)
        product = (self._slow_v - self._first_v) * (self._slow_y - self._first_y)
        self._product += self._forget * (product - self._product)

    @property
    def inverted(self) -> bool:
        """Whether displacement has gone against voltage, both counted from the start."""
        return self._product < 0.0
