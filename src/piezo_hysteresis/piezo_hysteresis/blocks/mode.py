"""One lightly damped mode of the mechanical structure."""

from math import pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold, mode_system
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot, System
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the position; state is (position [m], velocity [m/s]) at the next sample."""
    a11, a12, a21, a22 = hold(2.0 * pi * p[0], p[1], dt)
    b1, b2 = 1.0 - a11, -a21
    position, velocity = state[0], state[1]
    for k in range(x.size):
        # sampled before the new hold acts: y[k] depends on the inputs up to k - 1
        y[k] = position
        moved = a11 * position + a12 * velocity + b1 * x[k]
        velocity = a21 * position + a22 * velocity + b2 * x[k]
        position = moved
    state[0] = position
    state[1] = velocity


def system(p: FloatArray) -> System:
    """Return the mode as a linear system."""
    return mode_system(2.0 * pi * p[0], p[1])


BLOCK = Block(
    name='mode',
    part=InverseRole.STRUCTURE,
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter(
            'natural_frequency',
            'Hz',
            100.0,
            1e-2,
            1e6,
            'Undamped natural frequency of the first mode.',
            100.0,
        ),
        Parameter('damping_ratio', '1', 0.02, 1e-5, 50.0, 'Damping over critical damping.', 0.02),
    ),
    kernel=kernel,
    state_size=2,
    between=InterSample.LINEAR,
    inertia=True,
    system=system,
    description='One mode of unit DC gain by exact zero-order hold.',
    source='Zhou 2021 (3) with unit DC gain',
)
