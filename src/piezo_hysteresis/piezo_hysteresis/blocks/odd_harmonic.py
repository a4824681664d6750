"""Third and fifth harmonic of the drive added to the displacement, without recursion."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._harmonics import add_sine
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel3(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Add the third harmonic; state is (time of the first sample [s], cycles since)."""
    add_sine(x, y, state, p[0], p[1], dt, frequency, 3)


@jit
def kernel5(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Add the fifth harmonic; state is (time of the first sample [s], cycles since)."""
    add_sine(x, y, state, p[0], p[1], dt, frequency, 5)


BLOCKS = tuple(
    Block(
        name=f'harmonic{order}',
        slot=Slot.ADDED,
        parameters=tuple(
            Parameter(
                f'{kind}{order}',
                'm',
                0.0,
                -1.0,
                1.0,
                f'{kind.capitalize()} amplitude at {order} times the drive frequency.',
                1e-6,
            )
            for kind in ('sine', 'cosine')
        ),
        kernel=kernel,
        state_size=2,
        description=(
            f'Harmonic of order {order} with the phase of the drive; nothing where the drive has '
            'no fundamental frequency.'
        ),
        source=f'Fujii 2018 ({each}) without coefficients undetermined in steady state',
    )
    for order, kernel, each in ((3, kernel3, 6), (5, kernel5, 7))
)

EFFECTS = tuple(
    Effect(
        name='odd_harmonic',
        variant=block.name,
        block=block,
        neutral={parameter.name: 0.0 for parameter in block.parameters},
        starts=({parameter.name: 1e-6 for parameter in block.parameters},),
        physics=(
            'An oscillation at an odd multiple of the drive that the model does not produce. '
            'The papers describe it by exogenous sines; usually a harmonic excites a mode.'
        ),
        experiment=(
            'Neighbouring drive frequencies and a second amplitude: a mode makes the harmonic '
            'peak where n f meets its frequency, a fixed sine stays.'
        ),
        mistaken_for=('resonance', 'stiffness', 'saturation', 'hysteresis_exponent'),
    )
    for block in BLOCKS
)
