"""Constant offset of the sensor."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement as the sensor reads it; no state."""
    for k in range(x.size):
        y[k] = x[k] + p[0]


BLOCK = Block(
    name='offset',
    role=InverseRole.ZERO,
    slot=Slot.SENSOR,
    parameters=(Parameter('offset', 'm', 0.0, -1.0, 1.0, 'Reading of the sensor at zero.', 1e-5),),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Constant offset of the displacement.',
    source='missing in Fujii 2018; without it the free run is off by 16 to 160 um',
)

EFFECTS = (
    Effect(
        name='offset',
        block=BLOCK,
        neutral={'offset': 0.0},
        physics='The zero of the sensor is not the position at rest.',
        experiment='Record the displacement at rest before the first voltage is applied.',
        required_coverage=(Coverage.REST,),
        mistaken_for=('asymmetry', 'electrostriction', 'drift'),
    ),
)
