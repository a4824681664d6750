"""Notices a plant that answers with the opposite sign, which turns feedback into divergence."""

from __future__ import annotations

import math


class PolarityWatch:
    """Correlates voltage and displacement below the resonance, window by window.

    Two windows in a row with a clearly negative correlation mean an inverted sensor, amplifier or
    actuator.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    resonance : float
        Natural frequency [Hz]; above 0.7 of it the plant lags too much to judge. 0 if none.
    window : float
        Least seconds that are looked at together [s]; at least half a period.
    """

    def __init__(self, dt: float, resonance: float = 0.0, window: float = 0.05) -> None:
        self._dt = dt
        self._resonance = resonance
        self._window = window
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._against = 0
        self._clear()

    @property
    def inverted(self) -> bool:
        """Whether the plant was found to answer with the opposite sign."""
        return self._against >= 2

    def see(self, voltage: float, displacement: float, frequency: float) -> None:
        """Take one pair of voltage [V] and displacement [m] at the reference's frequency [Hz]."""
        if self._resonance > 0.0 and frequency > 0.7 * self._resonance:
            return
        self._count += 1
        share = 1.0 / self._count
        dv, dy = voltage - self._mean_v, displacement - self._mean_y
        self._mean_v += share * dv
        self._mean_y += share * dy
        self._vv += dv * (voltage - self._mean_v)
        self._yy += dy * (displacement - self._mean_y)
        self._vy += dv * (displacement - self._mean_y)
        length = max(self._window, 0.5 / frequency if frequency > 0.0 else 0.0)
        if self._count * self._dt >= length:
            self._judge()

    def _judge(self) -> None:
        scale = math.sqrt(self._vv * self._yy)
        if scale > 0.0 and self._vy < -0.7 * scale:
            self._against += 1
        elif scale > 0.0 and self._vy > 0.0:
            self._against = 0
        self._clear()

    def _clear(self) -> None:
        self._count = 0
        self._mean_v = self._mean_y = 0.0
        self._vv = self._yy = self._vy = 0.0
