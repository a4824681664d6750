"""Finds a sensor that moves against the voltage, or not with it, before a loop is closed."""

from __future__ import annotations

import math
from enum import Enum

from piezo_hysteresis.compensation.linear_gain import ModeGain

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


# Slow parts of voltage and displacement are compared: below this share of the natural frequency
# (or this frequency [Hz] where it is not known) the plant delays by much less than half a period.
_SHARE_OF_MODE, _WITHOUT_MODE = 0.3, 16.0
# The voltage has moved enough if the rms of its slow part is this share of the range of the
# voltage (a sinusoid of 0.7 % of it), and at least so much of its rms as a whole.
_SENSOR_SIGN_MOVED, _SLOW = 0.005, 0.5
# Correlations and slopes, relative to the expected one, from which the sensor is right or not.
_RIGHT, _WRONG, _LEAST_SLOPE, _STILL = 0.5, -0.7, 0.1, 0.05
# What speaks against the sensor must last so long [s]; older data count less after [s]; a loop
# whose voltage does not move is closed after [s].
_LASTS, _MEMORY, _TIMEOUT = 0.1, 2.0, 2.0


class Sign(Enum):
    """What is known of a sensor."""

    UNKNOWN = 'unknown'
    RIGHT = 'right'
    REVERSED = 'reversed'
    STILL = 'still'


class SensorSign:
    """Compares the displacement with the voltage until the sign of the sensor is known."""

    def __init__(self, dt: float) -> None:  # dt [s]
        self._dt = dt
        self._plant: ModeGain | None = None
        self._share = 1.0
        self._least = math.inf
        self._least_ticks = 0
        self.reset()

    def reset(self) -> None:
        """Discard all data."""
        self.found = Sign.UNKNOWN
        self._against = self._ticks = 0
        self._asked: int | None = None
        self._first: tuple[float, float] | None = None
        self._slow_v = self._slow_y = 0.0
        self._weight = self._v = self._vv = self._y = self._yy = self._vy = 0.0
        self._raw = self._raw_square = 0.0

    def expect(self, plant: ModeGain, span: float) -> None:  # span [V]
        """Set what is expected."""
        self._least = (_SENSOR_SIGN_MOVED * span) ** 2
        if plant == self._plant:
            return
        before, self._plant = self._plant, plant
        if self.found is Sign.RIGHT and before is not None and before.gain * plant.gain > 0.0:
            return
        corner = _SHARE_OF_MODE * plant.natural_frequency or _WITHOUT_MODE
        self._share = min(1.0, 2.0 * math.pi * corner * self._dt)
        self._least_ticks = max(20, math.ceil(3.0 / self._share))
        self.reset()

    def may_close(self) -> bool:
        """Return whether a loop may act now; it waits a time for a voltage that moves."""
        if self._asked is None:
            self._asked = self._ticks
        is_over = (self._ticks - self._asked) * self._dt >= _TIMEOUT
        if self.found is Sign.UNKNOWN and (is_over or self._plant is None):
            self.found = Sign.RIGHT
        return self.found is Sign.RIGHT

    def update(self, voltage: float, displacement: float) -> None:
        """Take the voltage [V] and the displacement [m] of one tick."""
        if self.found is not Sign.UNKNOWN or not math.isfinite(voltage + displacement):
            return
        if self._first is None:
            self._first = voltage, displacement
        v, y = voltage - self._first[0], displacement - self._first[1]
        self._slow_v += self._share * (v - self._slow_v)
        self._slow_y += self._share * (y - self._slow_y)
        keep, slow_v, slow_y = 1.0 - min(1.0, self._dt / _MEMORY), self._slow_v, self._slow_y
        self._ticks += 1
        self._weight = keep * self._weight + 1.0
        self._raw = keep * self._raw + v
        self._raw_square = keep * self._raw_square + v * v
        self._v = keep * self._v + slow_v
        self._y = keep * self._y + slow_y
        self._vv = keep * self._vv + slow_v * slow_v
        self._yy = keep * self._yy + slow_y * slow_y
        self._vy = keep * self._vy + slow_v * slow_y
        if self._ticks >= self._least_ticks:
            self._judge()

    def _judge(self) -> None:
        n = self._weight
        moved = self._vv / n - (self._v / n) ** 2
        whole = self._raw_square / n - (self._raw / n) ** 2
        if self._plant is None or moved < max(self._least, _SLOW**2 * whole):
            self._against = 0
            return
        answered = max(0.0, self._yy / n - (self._y / n) ** 2)
        both = math.copysign(1.0, self._plant.gain) * (self._vy / n - self._v * self._y / n**2)
        expected = 0.0 if math.isinf(self._plant.gain) else abs(self._plant.gain)
        correlation = both / math.sqrt(moved * answered) if answered > 0.0 else 0.0
        slope = both / moved
        if correlation >= _RIGHT and slope >= _LEAST_SLOPE * expected:
            self.found = Sign.RIGHT
            return
        opposite = correlation <= _WRONG and slope <= -_LEAST_SLOPE * expected
        still = answered <= (_STILL * expected) ** 2 * moved
        self._against = self._against + 1 if opposite or still else 0
        if self._against * self._dt >= _LASTS:
            self.found = Sign.REVERSED if opposite else Sign.STILL

    def counters(self) -> dict[str, int]:
        """Return what is found, 1 where it holds."""
        return {
            'reversed_sensor': int(self.found is Sign.REVERSED),
            'still_sensor': int(self.found is Sign.STILL),
        }
