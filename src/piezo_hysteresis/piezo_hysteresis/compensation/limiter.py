"""The last thing before the wire: range, slew and finiteness of the commanded voltage."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.errors import CompensationError


class Limiter:
    """Clamps range and slew of a voltage, one sample at a time, and counts what it did.

    Parameters
    ----------
    limits : Limits
        Range [V] and slew [V/s].
    dt : float
        Sampling interval [s].
    voltage : float
        The voltage at which it starts [V]; clamped to the range.

    Raises
    ------
    CompensationError
        If the range is empty, the slew or `dt` not positive, or any of them not finite.
    """

    def __init__(self, limits: Limits, dt: float, voltage: float = 0.0) -> None:
        if not (math.isfinite(limits.low) and math.isfinite(limits.high)):
            raise CompensationError('the voltage limits must be finite; give low and high in V')
        if not limits.low < limits.high:
            raise CompensationError(
                f'the voltage limits are empty: low = {limits.low:g} V is not below '
                f'high = {limits.high:g} V; exchange or widen them'
            )
        if not limits.slew > 0:
            raise CompensationError(
                f'the slew limit must be positive, got {limits.slew:g} V/s; give the largest '
                'change that the amplifier follows'
            )
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.limits = limits
        self.dt = dt
        self._step = limits.slew * dt
        self.reset(voltage)

    def reset(self, voltage: float = 0.0) -> None:
        """Start anew at `voltage` [V] with every counter at 0."""
        limits = self.limits
        start = voltage if math.isfinite(voltage) else 0.0
        self._voltage: float = min(max(start, limits.low), limits.high)
        self._counts: dict[str, int] = {'not_finite': 0, 'out_of_range': 0, 'slew_limited': 0}

    @property
    def voltage(self) -> float:
        """The last safe voltage that it answered [V]."""
        return self._voltage

    def apply(self, voltage: float) -> float:
        """Answer the safe voltage nearest to `voltage` [V].

        What is not a number is refused: the last safe voltage is held and ``not_finite`` counted.
        """
        limits = self.limits
        if not math.isfinite(voltage):
            self._counts['not_finite'] += 1
            return self._voltage
        safe = voltage
        if safe > limits.high or safe < limits.low:
            safe = min(max(safe, limits.low), limits.high)
            self._counts['out_of_range'] += 1
        if abs(safe - self._voltage) > self._step:
            safe = self._voltage + math.copysign(self._step, safe - self._voltage)
            self._counts['slew_limited'] += 1
        self._voltage = safe
        return safe

    def ramp_to_rest(self, rest: float = 0.0, duration: float = 1.0) -> float:
        """Answer the next voltage on the way to `rest`; call it once per tick.

        Parameters
        ----------
        rest : float
            Where to go [V]; clamped to the range.
        duration : float
            Seconds that the whole range would take [s]; never faster than the slew limit.
        """
        limits = self.limits
        goal = min(max(rest, limits.low), limits.high)
        pace = (limits.high - limits.low) * self.dt / duration if duration > 0 else self._step
        pace = min(pace, self._step)
        distance = goal - self._voltage
        if abs(distance) <= pace:
            self._voltage = goal
        else:
            self._voltage += math.copysign(pace, distance)
        return self._voltage

    def counters(self) -> dict[str, int]:
        """Return how many samples were ``not_finite``, ``out_of_range``, ``slew_limited``."""
        return dict(self._counts)
