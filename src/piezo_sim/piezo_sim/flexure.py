"""Guide with circular flexure hinges: spring stiffness from its dimensions.

The design of Fang et al. 2019: links of length L between two hinges each rotate by theta = x / L
when the stage moves by x, and the work of the force equals the energy in the hinges, so that
ke = n Kr / L^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezo_sim.simulation_errors import SimulationError


class FlexureError(SimulationError):
    """The dimensions of a flexure guide are invalid."""


@dataclass(frozen=True)
class Flexure:
    """A parallel guide of right circular hinges, Fang 2019 (stiffness); every length in m."""

    modulus: float  # young's modulus of the material [Pa]
    depth: float  # depth of the hinges, along their axis (b)
    thickness: float  # smallest thickness of the hinges (t)
    radius: float  # radius of the circular notches (R)
    link: float  # length of a link between its two hinges (L)
    hinges: int = 8  # number of bending hinges

    def __post_init__(self) -> None:
        for name in ('modulus', 'depth', 'thickness', 'radius', 'link'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise FlexureError(f'the {name} of the flexure must be positive, got {value:g}')
        if self.hinges < 1 or self.hinges != int(self.hinges):
            raise FlexureError(f'a flexure guide has 1 or more hinges, got {self.hinges}')

    @property
    def hinge_stiffness(self) -> float:
        """Kr = 2 E b t^(5/2) / (9 pi R^(1/2)) [N m/rad], for thicknesses much smaller than R."""
        e, b, t, r = self.modulus, self.depth, self.thickness, self.radius
        return 2.0 * e * b * math.pow(t, 2.5) / (9.0 * math.pi * math.sqrt(r))

    @property
    def exact_hinge_stiffness(self) -> float:
        """Kr by bending of the complete circular notch, without that approximation [N m/rad].

        The integral of 12 / (E b h(x)^3) over the hinge with h = t + 2 R - 2 sqrt(R^2 - x^2).
        """
        s = self.thickness / (2.0 * self.radius)
        q = s * (2.0 + s)
        turned = (
            (1.0 / (1.0 + s) + (3.0 + 2.0 * s + s * s) / ((1.0 + s) * q))
            + 6.0 * (1.0 + s) / math.pow(q, 1.5) * math.atan(math.sqrt((2.0 + s) / s))
        ) / q
        return 2.0 * self.modulus * self.depth * self.radius**2 / (3.0 * turned)

    @property
    def stiffness(self) -> float:
        """Stiffness of the guide in its direction of motion, ke = n Kr / L^2 [N/m]."""
        return self.hinges * self.hinge_stiffness / self.link**2

    @property
    def exact_stiffness(self) -> float:
        """Stiffness of the guide from `exact_hinge_stiffness` [N/m]."""
        return self.hinges * self.exact_hinge_stiffness / self.link**2

    def angle(self, displacement: float) -> float:
        """Return the rotation theta = x / L [rad] of a link for a displacement x [m]."""
        return displacement / self.link

    def energy(self, displacement: float) -> float:
        """Return the elastic energy in all hinges [J]: n Kr theta^2 / 2 = ke x^2 / 2."""
        return 0.5 * self.hinges * self.hinge_stiffness * self.angle(displacement) ** 2

    def left(self, actuator_stiffness: float) -> float:
        """Return the ratio of guided to free stroke of an actuator with a stiffness in N/m."""
        return actuator_stiffness / (actuator_stiffness + self.stiffness)

    def natural_frequency(self, actuator_stiffness: float, mass: float) -> float:
        """Return the first natural frequency of a mass [kg] on guide and actuator [Hz]."""
        return math.sqrt((actuator_stiffness + self.stiffness) / mass) / (2.0 * math.pi)
