"""How much power the amplifier spends on a capacitive load, and the slew that keeps to a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezo_hysteresis.errors import CompensationError

# Share of the window in which the allowed slew goes over to what can be kept up for ever.
_TAPER = 0.1


@dataclass(frozen=True)
class EnergyLimits:
    """The mean power that an amplifier may be asked for.

    An amplifier charges a piezo actuator from its supply and discharges it to the other rail, so
    that each way the charge ``C |dV|`` falls through the supply voltage U once in two: the mean
    power is ``P = C U <|dV/dt|> / 2``. For a periodic voltage with one rise and one fall of Vpp
    per period this is the well-known ``P = C f U Vpp`` of the makers' data sheets.

    Attributes
    ----------
    power : float
        Largest running mean of P [W]; 0 sets no limit.
    capacitance : float
        C of the actuator at large signals [F]. Where the voltage of the chain drives an amplifier
        of gain G, give ``G^2 C``.
    window : float
        Time constant of the exponential running mean [s].
    supply : float
        U, the span between the rails in volts of the chain [V].
    """

    power: float = 0.0
    capacitance: float = 1e-6
    window: float = 1.0
    supply: float = 2.4

    @property
    def sustained_slew(self) -> float:
        """Mean of ``|dV/dt|`` that can be kept up for ever [V/s]."""
        return 2.0 * self.power / (self.capacitance * self.supply) if self.power else math.inf


class EnergyMeter:
    """Keeps the running mean power of a voltage below its limit by bounding each change.

    The mean is ``p[k] = p[k-1] + (dt / T) (q[k] - p[k-1])`` with ``q = C U |dV| / (2 dt)``. A
    change may spend ``q <= P + (T / S) (P - p[k-1])`` with S a tenth of T: bursts from rest may be
    eleven times as fast as what is sustained, and the bound falls smoothly while the mean rises.
    As ``p[k] <= p[k-1] + (dt / T + dt / S) (P - p[k-1])``, the mean never exceeds P.

    Parameters
    ----------
    limits : EnergyLimits
        Power, capacitance, window, supply.
    dt : float
        Sampling interval [s].

    Raises
    ------
    CompensationError
        If a value is negative, zero where it must not be, or not finite, or the window is shorter
        than eleven samples.
    """

    def __init__(self, limits: EnergyLimits, dt: float) -> None:
        self._mean = 0.0
        self._dt = dt
        self.limits = limits

    @property
    def limits(self) -> EnergyLimits:
        """The limits in force; the mean goes on when they change."""
        return self._limits

    @limits.setter
    def limits(self, limits: EnergyLimits) -> None:
        values = (limits.power, limits.capacitance, limits.window, limits.supply)
        if not all(math.isfinite(value) for value in values):
            raise CompensationError('the energy limit must be finite; give 0 W for none')
        if limits.power < 0.0:
            raise CompensationError(f'energy_limit must not be negative, got {limits.power:g} W')
        if min(values[1:]) <= 0.0:
            raise CompensationError('capacitance, window and supply voltage must be positive')
        share = self._dt / limits.window
        if share * (1.0 + 1.0 / _TAPER) > 1.0:
            raise CompensationError(
                f'the window of the energy limit is too short: {limits.window:g} s is less than '
                f'eleven samples of {self._dt:g} s'
            )
        self._limits = limits
        self._share = share
        # Power of a change of one volt within one sample [W/V].
        self._per_volt = 0.5 * limits.capacitance * limits.supply / self._dt

    @property
    def mean_power(self) -> float:
        """Running mean of the power [W]."""
        return self._mean

    def largest_step(self) -> float:
        """Return the largest change that the next sample may make [V]."""
        power = self._limits.power
        if power == 0.0:
            return math.inf
        # A limit that was lowered leaves the mean above it: hold while it falls.
        return max(0.0, power + (power - self._mean) / _TAPER) / self._per_volt

    def note(self, change: float) -> None:
        """Take note that the voltage changed by `change` [V] within one sample."""
        self._mean += self._share * (self._per_volt * abs(change) - self._mean)

    def reset(self) -> None:
        """Forget what was spent."""
        self._mean = 0.0
