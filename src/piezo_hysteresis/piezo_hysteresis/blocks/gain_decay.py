"""Decay of the gain with time."""

from math import expm1

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v (1 - loss (1 - exp(-t/tau)))``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] * (1.0 + p[0] * expm1(-count * dt / p[1]))
        count += 1.0
    state[0] = count


BLOCK = Block(
    name='gain_decay',
    slot=Slot.SLOW,
    parameters=(
        Parameter(
            'gain_loss', '1', 0.0, 0.0, 1.0, 'Final share of the stroke that is lost.', 0.05
        ),
        Parameter(
            'gain_loss_time',
            's',
            10.0,
            1e-2,
            1e7,
            'Time constant of the loss; with a loss of 1 the stroke decays exponentially.',
            10.0,
        ),
    ),
    kernel=kernel,
    state_size=1,
    between=InterSample.CLOCK,
    description='Stroke that shrinks since the start of the record.',
    source='fatigue, depolarisation, self-heating',
)

EFFECTS = (
    Effect(
        name='gain_decay',
        block=BLOCK,
        neutral={'gain_loss': 0.0},
        starts=(
            {'gain_loss': 0.02},
            {'gain_loss_time': 1.0},
            {'gain_loss_time': 1e3, 'gain_loss': 0.5},
        ),
        physics=(
            'The ceramic depolarises, heats up or fatigues, so the displacement per volt '
            'decreases.'
        ),
        experiment=(
            'Repeat the first record at the end: the amplitude has changed, the mean has not.'
        ),
        mistaken_for=('drift', 'creep'),
    ),
)
