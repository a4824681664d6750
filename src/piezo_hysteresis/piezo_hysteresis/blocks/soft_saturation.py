"""Gradual saturation of the voltage or the polarisation."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``u / (1 + |u / L|^k)^(1 / k)``, ``L`` by the sign of ``u``; no state."""
    knee = p[2]
    for i in range(x.size):
        limit = p[0] if x[i] > 0.0 else p[1]
        part = abs(x[i]) / limit
        if part <= 1.0:
            y[i] = x[i] * (1.0 + part**knee) ** (-1.0 / knee)
        else:
            # power of the smaller ratio, so that a sharp knee far below the drive does not
            # overflow
            y[i] = x[i] / part * (1.0 + part**-knee) ** (-1.0 / knee)


BLOCK = Block(
    name='soft_saturation',
    slot=Slot.INPUT,
    parameters=(
        Parameter('soft_high', 'V', 1e5, 1e-6, 1e5, 'Voltage that is approached.', 1.0),
        Parameter('soft_low', 'V', 1e5, 1e-6, 1e5, 'Negative voltage that is approached.', 1.0),
        Parameter('knee', '1', 10.0, 1.0, 50.0, 'Sharpness of the knee; the larger the harder.'),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Limits of the voltage that are approached over a knee.',
    source='knee of a power amplifier (Rapp 1991), a limit for either sign',
)

EFFECTS = (
    Effect(
        name='saturation',
        block=BLOCK,
        neutral={'soft_high': 1e5, 'soft_low': 1e5, 'knee': 10.0},
        starts=(
            {'soft_high': 2.0, 'soft_low': 2.0, 'knee': 2.0},
            {'soft_high': 4.0, 'soft_low': 4.0},
            {'soft_low': 1e5},
            {'soft_high': 1e5},
        ),
        physics=(
            'The gain of the amplifier decreases before it reaches its rails, or the polarisation '
            'of the ceramic approaches its limit: the drive is rounded, and the loop follows it.'
        ),
        experiment='An amplitude ladder: the gain falls steadily towards the tips.',
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('stiffness', 'electrostriction', 'odd_harmonic'),
    ),
)
