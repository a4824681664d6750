"""The last thing before the wire: range, slew, energy and finiteness of the commanded voltage."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.energy import EnergyLimits, EnergyMeter
from piezo_hysteresis.errors import CompensationError

COUNTS = ('not_finite', 'out_of_range', 'slew_limited', 'energy_limited')


class Limiter:
    """Clamps range, slew and mean power of a voltage sample by sample, and counts what it did.

    Parameters
    ----------
    limits : Limits
        Range [V] and slew [V/s].
    dt : float
        Sampling interval [s].
    voltage : float
        The voltage at which it starts [V]; clamped to the range.
    energy : EnergyLimits, optional
        Mean power; without one there is no limit.

    Raises
    ------
    CompensationError
        If the range is empty, the slew or `dt` not positive, or any of them not finite.
    """

    def __init__(
        self,
        limits: Limits,
        dt: float,
        voltage: float = 0.0,
        energy: EnergyLimits | None = None,
    ) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        self._take(limits)
        self._meter = None if energy is None else EnergyMeter(energy, dt)
        self.reset(voltage)

    def _take(self, limits: Limits) -> None:
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
        self.limits = limits
        self._step = limits.slew * self.dt

    def retune(self, limits: Limits, energy: EnergyLimits | None = None) -> None:
        """Take other limits over while running; counters and the last voltage stay.

        A last voltage beyond the new range is brought in at the slew limit, not by a jump.

        Raises
        ------
        CompensationError
            If they are impossible; the ones before then stay in force.
        """
        meter = None if energy is None else EnergyMeter(energy, self.dt)
        self._take(limits)
        if energy is not None and self._meter is not None:
            self._meter.limits = energy
        else:
            self._meter = meter

    def reset(self, voltage: float = 0.0) -> None:
        """Start anew at `voltage` [V], clamped to the range, with every counter at 0."""
        limits = self.limits
        start = voltage if math.isfinite(voltage) else 0.0
        self._voltage: float = min(max(start, limits.low), limits.high)
        self._counts: dict[str, int] = dict.fromkeys(COUNTS, 0)
        if self._meter is not None:
            self._meter.reset()

    def follow(self, voltage: float) -> None:
        """Take `voltage` [V] for the last one, where something else has moved it meanwhile."""
        if math.isfinite(voltage):
            self._voltage = voltage

    @property
    def voltage(self) -> float:
        """The last safe voltage that it answered [V]."""
        return self._voltage

    @property
    def mean_power(self) -> float:
        """Running mean of the power that the voltage takes [W]; 0 without energy limits."""
        return 0.0 if self._meter is None else self._meter.mean_power

    def apply(self, voltage: float) -> float:
        """Answer the safe voltage nearest to `voltage` [V].

        What is not a number is refused: the last safe voltage is held and ``not_finite`` counted.
        """
        limits = self.limits
        if not math.isfinite(voltage):
            self._counts['not_finite'] += 1
            voltage = self._voltage
        if voltage > limits.high or voltage < limits.low:
            voltage = min(max(voltage, limits.low), limits.high)
            self._counts['out_of_range'] += 1
        return self._go(voltage)

    def ramp_to_rest(self, rest: float = 0.0, duration: float = 1.0) -> float:
        """Answer the next voltage on the way to `rest`; call it once per tick.

        Parameters
        ----------
        rest : float
            Where to go [V]; clamped to the range.
        duration : float
            Seconds that the whole range would take [s]; never faster than the slew limit.
        """
        span = self.limits.high - self.limits.low
        return self.ramp_to(rest, span / duration if duration > 0 else math.inf)

    def ramp_to(self, rest: float, ramp: float) -> float:
        """Answer the next voltage on the way to `rest` [V] at `ramp` [V/s]; once per tick.

        Never faster than the slew limit, and counted as limited only where the energy limit slows
        the ramp.
        """
        goal = min(max(rest, self.limits.low), self.limits.high)
        pace = min(ramp * self.dt, self._step)
        distance = goal - self._voltage
        if abs(distance) > pace:
            goal = self._voltage + math.copysign(pace, distance)
        return self._go(goal)

    def _go(self, goal: float) -> float:
        """Go towards `goal` as far as slew and energy allow."""
        before, step, reason = self._voltage, self._step, 'slew_limited'
        if self._meter is not None:
            affordable = self._meter.largest_step()
            if affordable < step:
                step, reason = affordable, 'energy_limited'
        if abs(goal - before) > step:
            goal = before + math.copysign(step, goal - before)
            self._counts[reason] += 1
        self._voltage = goal
        if self._meter is not None:
            self._meter.note(goal - before)
        return goal

    def counters(self) -> dict[str, int]:
        """Return how many samples were refused or limited, by the names of `COUNTS`."""
        return dict(self._counts)
