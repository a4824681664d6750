"""Electrostriction: strain proportional to the square of the voltage."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``e u^2`` [m]; no state."""
    for k in range(x.size):
        y[k] = p[0] * x[k] * x[k]


@jit
def input_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``u + q u^2`` [V]; no state."""
    for k in range(x.size):
        y[k] = x[k] + p[0] * x[k] * x[k]


BLOCKS = (
    Block(
        name='electrostriction',
        slot=Slot.HYSTERESIS,
        parameters=(
            Parameter(
                'electrostriction',
                'm/V^2',
                0.0,
                -1e-2,
                1e-2,
                'Strain of the square of the voltage.',
                2e-6,
            ),
        ),
        kernel=kernel,
        between=InterSample.INSTANT,
        description='Square law of the voltage in parallel with piezo effect and hysteresis.',
        source='strain of the square of the field',
    ),
    Block(
        name='square_law',
        slot=Slot.INPUT,
        parameters=(
            Parameter(
                'square_law', '1/V', 0.0, -1e3, 1e3, 'Quadratic over linear input at 1 V.', 0.02
            ),
        ),
        kernel=input_kernel,
        between=InterSample.INSTANT,
        description='Square law of the amplifier, before the hysteresis.',
        source='amplifier whose gain depends on the voltage',
    ),
)

_PHYSICS = (
    'Electrostriction adds a strain that has the same sign for either voltage.',
    'The amplifier is not linear: its gain grows with the voltage.',
)

EFFECTS = tuple(
    Effect(
        name='electrostriction',
        block=block,
        neutral={block.parameters[0].name: 0.0},
        starts=(
            {block.parameters[0].name: block.parameters[0].scale},
            {block.parameters[0].name: -block.parameters[0].scale},
        ),
        physics=physics,
        experiment=(
            'Two amplitudes: mean and second harmonic fall to a quarter at half the amplitude '
            'and do not depend on the frequency.'
        ),
        mistaken_for=('asymmetry', 'sensor_nonlinearity', 'offset'),
    )
    for block, physics in zip(BLOCKS, _PHYSICS, strict=True)
)
