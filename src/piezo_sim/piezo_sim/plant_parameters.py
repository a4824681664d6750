"""Definition of parameters and effects of the simulator, and scaling of the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

# Voltage of the actuator for which the default values in the tables are valid.
NOMINAL_VOLTAGE = 1.0
NOMINAL_DISPLACEMENT = 100e-6


@dataclass(frozen=True)
class PlantParameter:
    """One parameter of the simulated actuator.

    Attributes
    ----------
    name : str
        ``part.quantity``; also the name of the ROS parameter.
    unit : str
        SI unit, ``1`` for a dimensionless one.
    default : float
        Value without an entry in the preset, for an actuator that moves 100 µm at 1 V; `scaled`
        converts it for other actuators.
    low, high : float
        Bounds; values outside are physically impossible or beyond the range of the integrator.
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
    """A property of the actuator that can be switched on and off during operation.

    Attributes
    ----------
    name : str
        Name; the switch is the parameter ``effects.<name>``.
    description : str
        One sentence.
    neutral : mapping of str to float
        Values of the parameters of the effect while it is off.
    exotic : bool
        True for effects that no candidate of the discovery describes. They must stay without a
        block, because they serve tests in which the correct answer is ``unknown``; a library that
        is extended after its test cases could not be tested.
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
