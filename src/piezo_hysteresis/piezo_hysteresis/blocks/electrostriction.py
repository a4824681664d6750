"""Strain that grows with the square of the voltage."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``u + q u^2`` [V]; no state."""
    for k in range(x.size):
        y[k] = x[k] + p[0] * x[k] * x[k]


BLOCK = Block(
    name='electrostriction',
    slot=Slot.INPUT,
    parameters=(
        Parameter(
            'square_law',
            '1/V',
            0.0,
            -1e3,
            1e3,
            'Quadratic over linear strain at 1 V.',
            0.02,
        ),
    ),
    kernel=kernel,
    state_size=0,
    description='Square law of the input: electrostriction beside the piezo effect.',
    source='EQUATIONS F, quadratic',
)

EFFECTS = (
    Effect(
        name='electrostriction',
        variant='electrostriction',
        block=BLOCK,
        neutral={'square_law': 0.0},
        start={'square_law': 0.02},
        alternatives=({'square_law': -0.02},),
        physics='Electrostriction adds a strain that has the same sign for either voltage.',
        experiment=(
            'Two amplitudes: mean and second harmonic fall to a quarter at half the amplitude '
            'and do not depend on the frequency.'
        ),
        mistaken_for=('asymmetry', 'sensor_nonlinearity', 'offset'),
    ),
)
