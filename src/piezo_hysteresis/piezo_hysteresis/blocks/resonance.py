"""A mode of which the quasi-static displacement has only a share."""

from math import pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``(1 - share) v + share q``; state is (q [m], q' [m/s]) at the next sample."""
    a11, a12, a21, a22 = hold(2.0 * pi * p[0], p[1], dt)
    b1, b2 = 1.0 - a11, -a21
    share = p[2]
    position, velocity = state[0], state[1]
    for k in range(x.size):
        y[k] = x[k] + share * (position - x[k])
        moved = a11 * position + a12 * velocity + b1 * x[k]
        velocity = a21 * position + a22 * velocity + b2 * x[k]
        position = moved
    state[0] = position
    state[1] = velocity


def guess(seen: Residual) -> dict[str, float]:
    """Return the frequency at which the residual is largest against the simulated displacement.

    Hysteresis puts odd harmonics everywhere; a mode makes those near it stand out.
    """
    window = np.hanning(seen.residual.size)
    left = np.abs(np.fft.rfft(window * (seen.residual - seen.residual.mean())))
    moved = np.abs(np.fft.rfft(window * (seen.simulated - seen.simulated.mean())))
    ratio = left**2 / (moved + 0.01 * moved.max() + 1e-300)
    ratio[:3] = 0.0
    place = int(np.argmax(ratio))
    if place == 0 or ratio[place] == 0.0:
        return {}
    return {'resonance_frequency': place / (seen.residual.size * seen.dt)}


BLOCK = Block(
    name='resonance',
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter(
            'resonance_frequency', 'Hz', 68.0, 1e-2, 1e6, 'Undamped natural frequency.', 68.0
        ),
        Parameter(
            'resonance_damping',
            '1',
            0.02,
            1e-5,
            0.3,
            'Damping over critical; beyond 0.3 hardly anything stands out.',
            0.02,
        ),
        Parameter(
            'resonance_share',
            '1',
            0.0,
            -2.0,
            2.0,
            'Share of the static displacement that the mode carries; 1 is a mode in series.',
            0.5,
        ),
    ),
    kernel=kernel,
    state_size=2,
    description='A further mode that carries a share of the static displacement.',
    source='002 (3); 000 where 14 and 23 Hz drives hit a mode near 68 Hz',
)

EFFECTS = (
    Effect(
        name='resonance',
        variant='resonance',
        repeatable=True,
        block=BLOCK,
        neutral={'resonance_share': 0.0},
        start={'resonance_share': 1.0, 'resonance_damping': 0.02},
        alternatives=tuple(
            {'resonance_frequency': each} for each in (30.0, 100.0, 200.0, 400.0, 800.0)
        ),
        guess=guess,
        physics=(
            'A lightly damped mode of the structure rings where the drive, or one of the odd '
            'harmonics that hysteresis makes of it, comes near its frequency.'
        ),
        experiment=(
            'A sweep in which n times the drive passes the suspected frequency (n = 1, 3, 5, 7), '
            'or a chirp to above it.'
        ),
        mistaken_for=('odd_harmonic', 'transport_delay', 'amplifier_lag', 'rate_dependence'),
    ),
)
