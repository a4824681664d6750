"""How much power the amplifier spends on a capacitive load, and the slew that keeps to a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit, leaf

# Share of the window in which the allowed slew decreases to the sustained value.
TAPER = 0.1


@dataclass(frozen=True)
class EnergyLimits:
    """Limit of the mean power of an amplifier.

    An amplifier charges a piezo actuator from its supply and discharges it to the other rail, so
    that the charge ``C |dV|`` passes the supply voltage U once per two changes: the mean power is
    ``P = C U <|dV/dt|> / 2``. For a periodic voltage with one rise and one fall of Vpp per period
    this is the well-known ``P = C f U Vpp`` of the makers' data sheets.
    """

    power: float = 0.0  # largest running mean of P [W]; 0 sets no limit
    capacitance: float = 1e-6  # C of the actuator at large signals [F]
    window: float = 1.0  # time constant of the exponential running mean [s]
    supply: float = 2.4  # U, the span between the rails in volts of the chain [V]

    @property
    def sustained_slew(self) -> float:
        """Sustained mean of ``|dV/dt|`` [V/s]."""
        return 2.0 * self.power / (self.capacitance * self.supply) if self.power else math.inf


def packed_energy(limits: EnergyLimits, dt: float) -> tuple[float, float, float]:
    """Return power [W], share of a tick in the mean, and power of a volt in a tick [W/V]."""
    values = (limits.power, limits.capacitance, limits.window, limits.supply)
    if not all(math.isfinite(value) for value in values):
        raise CompensationError('the energy limit must be finite; give 0 W for none')
    if limits.power < 0.0:
        raise CompensationError(f'energy_limit must not be negative, got {limits.power:g} W')
    if min(values[1:]) <= 0.0:
        raise CompensationError('capacitance, window and supply voltage must be positive')
    capacitance, window, supply = map(float, values[1:])
    share, per_volt = energy_numbers(capacitance, window, supply, dt)
    if not slow_enough(share):
        raise CompensationError(
            f'the window of the energy limit is too short: {limits.window:g} s is less than '
            f'eleven samples of {dt:g} s'
        )
    return limits.power, share, per_volt


@jit
def energy_numbers(
    capacitance: float, window: float, supply: float, dt: float
) -> tuple[float, float]:
    """Return the share of a tick in the mean, and the power of a volt in a tick [W/V]."""
    return dt / window, 0.5 * capacitance * supply / dt


@jit
def slow_enough(share: float) -> bool:
    """Return whether the window is long enough for the bound of `largest_change`."""
    return bool(share * (1.0 + 1.0 / TAPER) <= 1.0)


@leaf
def largest_change(mean: float, power: float, per_volt: float) -> float:
    """Return the largest change that the next sample may make [V].

    The mean is ``p[k] = p[k-1] + (dt / T) (q[k] - p[k-1])`` with ``q = C U |dV| / (2 dt)``. A
    change may spend ``q <= P + (T / S) (P - p[k-1])`` with S a tenth of T: bursts from rest may
    have eleven times the sustained rate, and the bound decreases smoothly as the mean rises. As
    ``p[k] <= p[k-1] + (dt / T + dt / S) (P - p[k-1])``, the mean never exceeds P.
    """
    if power == 0.0:
        return math.inf
    # A limit that was lowered leaves the mean above it: hold while it falls.
    return max(0.0, power + (power - mean) / TAPER) / per_volt
