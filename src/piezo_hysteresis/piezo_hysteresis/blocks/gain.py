"""Linear gain: an actuator without hysteresis."""

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import LINEAR_GAIN
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Slot, System
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``A1 u``; no state."""
    for k in range(x.size):
        y[k] = p[0] * x[k]


def system(p: FloatArray) -> System:
    """Return the gain as a linear system."""
    return System(np.zeros((0, 0)), np.zeros(0), np.zeros(0), float(p[0]))


BLOCK = Block(
    name='gain',
    role=InverseRole.GAIN,
    slot=Slot.HYSTERESIS,
    parameters=(LINEAR_GAIN,),
    kernel=kernel,
    between=InterSample.INSTANT,
    system=system,
    description='Linear gain without memory.',
    source='Fujii 2018 (2) with h = 0',
)
