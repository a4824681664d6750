"""The vocabulary of the simulator: what a parameter and an effect are, and how defaults scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

# The actuator that the default values in the tables are meant for.
NOMINAL_VOLTAGE = 1.0
NOMINAL_DISPLACEMENT = 100e-6


@dataclass(frozen=True)
class PlantParameter:
    """One number of the simulated actuator.

    Attributes
    ----------
    name : str
        ``part.quantity``; also the name of the ROS parameter.
    unit : str
        SI unit, ``1`` where there is none.
    default : float
        Value used where a preset says nothing, for an actuator that moves 100 um at 1 V;
        `scaled` gives it for other actuators.
    low, high : float
        Values outside are physically impossible, or beyond what the simulator integrates.
    description : str
        One sentence.
    """

    name: str
    unit: str
    default: float
    low: float
    high: float
    description: str

    def scaled(self, voltage: float, displacement: float) -> float:
        """Return the default for an actuator that moves `displacement` [m] at `voltage` [V]."""
        volts, metres = dimensions(self.unit)
        factor = (voltage / NOMINAL_VOLTAGE) ** volts
        factor *= (displacement / NOMINAL_DISPLACEMENT) ** metres
        return min(max(self.default * factor, self.low), self.high)


@dataclass(frozen=True)
class PlantEffect:
    """Something the actuator does that can be switched on and off while it runs.

    Attributes
    ----------
    name : str
        Word for it; the switch is the parameter ``effects.<name>``.
    description : str
        One sentence.
    neutral : mapping of str to float
        What the parameters of the effect are replaced by while it is off.
    exotic : bool
        True for effects that no candidate of the discovery describes, and that stay so: no block
        is to be written after them. They are for tests in which the right answer is ``unknown``,
        and a vocabulary that follows its test worlds could not be tested at all.
    """

    name: str
    description: str
    neutral: Mapping[str, float] = field(default_factory=dict)
    exotic: bool = False


def dimensions(unit: str) -> tuple[int, int]:
    """Return the powers of volt and metre in `unit`, such as ``m/V^2``."""
    powers = {'V': 0, 'm': 0}
    for place, half in enumerate(unit.split('/')):
        for part in half.split():
            base, _, power = part.partition('^')
            if base in powers:
                powers[base] += int(power or 1) * (1 if place == 0 else -1)
    return powers['V'], powers['m']
