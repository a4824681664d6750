"""Detects a sensor that repeats its reading while the voltage moves."""

from __future__ import annotations

import math

# Readings that differ by less, relative to themselves, are equal: the last bit of a float32.
LAST_BIT = 1.2e-7
# The sensor is stuck after this time [s], if the voltage has moved by this share of its largest
# magnitude in that time.
STUCK_AFTER = 0.1
_MOVED = 0.02


class StuckSensor:
    """Counts the ticks at which a sensor is stuck."""

    def __init__(self, dt: float) -> None:  # dt [s]
        self.ticks = 0
        self._needed = max(20, math.ceil(STUCK_AFTER / dt))
        self._reading, self._equal = math.nan, 0
        self._low = self._high = self._largest = 0.0

    def update(self, voltage: float, displacement: float) -> None:
        """Take the voltage [V] and the displacement [m] of one tick."""
        if not abs(displacement - self._reading) <= LAST_BIT * abs(self._reading):
            self._reading, self._equal = displacement, 0
            self._low = self._high = voltage
            return
        self._equal += 1
        self._low, self._high = min(self._low, voltage), max(self._high, voltage)
        self._largest = max(self._largest, abs(voltage))
        moved = self._high - self._low > _MOVED * self._largest
        self.ticks += moved and self._equal >= self._needed
