"""A stroke that shrinks with time."""

from math import exp

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``v exp(-rate t)``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] * exp(-p[0] * (count * dt))
        count += 1.0
    state[0] = count


BLOCK = Block(
    name='gain_decay',
    slot=Slot.SLOW,
    parameters=(
        Parameter(
            'gain_decay_rate',
            '1/s',
            0.0,
            -0.1,
            100.0,
            'Share of the stroke lost per second.',
            1e-3,
        ),
    ),
    kernel=kernel,
    state_size=1,
    description='Stroke that decays exponentially since the start of the record.',
    source='fatigue, depolarisation, self-heating',
)

EFFECTS = (
    Effect(
        name='gain_decay',
        variant='gain_decay',
        block=BLOCK,
        neutral={'gain_decay_rate': 0.0},
        start={'gain_decay_rate': 1e-3},
        alternatives=({'gain_decay_rate': -1e-3},),
        physics=(
            'The ceramic depolarises, heats up or tires, so that the same voltage moves it less '
            'and less.'
        ),
        experiment=(
            'Repeat the first record at the end: the amplitude has changed, the mean has not.'
        ),
        mistaken_for=('drift', 'creep'),
    ),
)
