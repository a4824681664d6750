"""An amplifier that runs out of voltage."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the voltage within the range of the amplifier; no state."""
    for k in range(x.size):
        y[k] = min(max(x[k], -p[1]), p[0])


BLOCK = Block(
    name='saturation',
    slot=Slot.INPUT,
    parameters=(
        Parameter('saturation_high', 'V', 1e5, 0.0, 1e5, 'Largest voltage that arrives.', 1.0),
        Parameter(
            'saturation_low', 'V', 1e5, 0.0, 1e5, 'Largest negative voltage that arrives.', 1.0
        ),
    ),
    kernel=kernel,
    state_size=0,
    description='Hard limits of the voltage.',
    source='output range of the amplifier',
)


def guess(seen: Residual) -> dict[str, float]:
    """Return limits a little inside what was commanded, so that a fit sees their slope."""
    high, low = float(seen.voltage.max()), float(-seen.voltage.min())
    return {
        name: 0.9 * reached if reached > 0.0 else 1e5
        for name, reached in (('saturation_high', high), ('saturation_low', low))
    }


EFFECTS = (
    Effect(
        name='saturation',
        variant='saturation',
        block=BLOCK,
        neutral={'saturation_high': 1e5, 'saturation_low': 1e5},
        start={'saturation_high': 0.9, 'saturation_low': 0.9},
        alternatives=(
            {'saturation_high': 0.7, 'saturation_low': 0.7},
            {'saturation_low': 1e5},
            {'saturation_high': 1e5},
        ),
        guess=guess,
        physics='The amplifier cannot deliver more than its rails; the tips of the drive are cut.',
        experiment='An amplitude ladder: nothing below a threshold, flat tips above it.',
        mistaken_for=('stiffness', 'slew_limit', 'odd_harmonic'),
    ),
)
