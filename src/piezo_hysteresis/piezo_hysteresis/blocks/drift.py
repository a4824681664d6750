"""A displacement that runs away."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``v + rate t``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] + p[0] * (count * dt)
        count += 1.0
    state[0] = count


BLOCK = Block(
    name='drift',
    slot=Slot.SLOW,
    parameters=(
        Parameter(
            'drift_rate',
            'm/s',
            0.0,
            -1e-2,
            1e-2,
            'Slope of the displacement since the start of the record.',
            1e-7,
        ),
    ),
    kernel=kernel,
    state_size=1,
    description='Constant drift, independent of the drive.',
    source='EQUATIONS F, drift',
)

EFFECTS = (
    Effect(
        name='drift',
        variant='drift',
        block=BLOCK,
        neutral={'drift_rate': 0.0},
        start={'drift_rate': 1e-7},
        alternatives=({'drift_rate': -1e-7},),
        physics='Temperature moves the mount or the sensor electronics, whatever the drive does.',
        experiment='A record at 0 V: drift goes on without drive, creep and asymmetry do not.',
        mistaken_for=('creep', 'asymmetry', 'offset', 'gain_decay'),
    ),
)
