"""Second-order structure of Zhou 2021, by mass, damping and stiffness."""

from collections.abc import Mapping
from math import pi, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold, mode_system
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot, System
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the position; state is (position [m], velocity [m/s]) at the next sample."""
    mass, damping, stiffness = p[0], p[1], p[2]
    ratio = 0.5 * damping / sqrt(mass * stiffness)
    a11, a12, a21, a22 = hold(sqrt(stiffness / mass), ratio, dt)
    b1, b2 = 1.0 - a11, -a21
    position, velocity = state[0], state[1]
    for k in range(x.size):
        y[k] = position  # before the new hold acts, as in mode
        moved = a11 * position + a12 * velocity + b1 * x[k]
        velocity = a21 * position + a22 * velocity + b2 * x[k]
        position = moved
    state[0] = position
    state[1] = velocity


def system(p: FloatArray) -> System:
    """Return the structure as a linear system."""
    return mode_system(sqrt(p[2] / p[0]), 0.5 * p[1] / sqrt(p[0] * p[2]))


def tuned(values: Mapping[str, float], mode: Mapping[str, float]) -> dict[str, float]:
    """Return mass and damping for a mode, in addition to the other values in `mode`."""
    others = {k: v for k, v in mode.items() if k not in ('natural_frequency', 'damping_ratio')}
    stiffness, mass = values['stiffness'], values['mass']
    ratio = mode.get('damping_ratio', 0.5 * values['damping'] / sqrt(mass * stiffness))
    if 'natural_frequency' in mode:
        mass = stiffness / (2.0 * pi * mode['natural_frequency']) ** 2
    return {**others, 'mass': mass, 'damping': 2.0 * ratio * sqrt(mass * stiffness)}


BLOCK = Block(
    name='mass_spring',
    part=InverseRole.STRUCTURE,
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter('mass', 'kg', 0.0514, 1e-9, 1e5, 'Moving mass m.', 0.05),
        Parameter('damping', 'N*s/m', 513.0, 1e-9, 1e9, 'Viscous damping b.', 500.0),
        Parameter('stiffness', 'N/m', 8.0e5, 1e-3, 1e12, 'Stiffness k.', 8e5),
    ),
    kernel=kernel,
    state_size=2,
    between=InterSample.LINEAR,
    inertia=True,
    system=system,
    tuned=tuned,
    description=(
        "m x'' + b x' + k x = k v by exact zero-order hold; voltage and displacement see the "
        'ratios m/k and b/k only, so the stiffness is held at the value of the data sheet.'
    ),
    source='Zhou 2021 (3), (4), (5); its table 2 with corrected units (m 0.0514 kg, k 8.0e5 N/m)',
)
