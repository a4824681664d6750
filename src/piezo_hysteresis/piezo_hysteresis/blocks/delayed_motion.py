"""Motion that comes late by any fraction of a sample: a delayed command before a moving mass."""

from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.transport_delay import EFFECTS as DELAYS
from piezo_hysteresis.blocks.transport_delay import LONGEST, state_size
from piezo_hysteresis.jit import jit

_POINTS = 6  # neighbours that an interpolation knows
_NEWER = 2  # of those newer than what is sought, where there are so many

_MOVING = ('mode', 'mode_pair', 'eased_mode', 'nonlinear_mode', 'mass_spring', 'resonance')


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the motion `p[0]` seconds ago; state is the place to write and a ring of it [m].

    A delay passes through a chain that does not change with time. Behind a mass the motion is
    smooth, so that a polynomial tells it between the ticks; the held voltage is not.
    """
    length = state.size - 1
    shift = p[0] / dt
    whole = int(shift)
    first = whole - min(whole, _NEWER)
    weights = np.ones(_POINTS)
    for i in range(_POINTS):
        for j in range(_POINTS):
            if j != i:
                weights[i] *= (shift - first - j) / (i - j)
    place = int(state[0])
    for k in range(x.size):
        state[1 + place] = x[k]
        total = 0.0
        for i in range(_POINTS):
            at = place - first - i
            total += weights[i] * state[1 + (at if at >= 0 else at + length)]
        y[k] = total
        place = place + 1 if place + 1 < length else 0
    state[0] = place


def ring_size(dt: float) -> int:
    """Return room for the longest delay and the neighbours of it."""
    return state_size(dt) + _POINTS


BLOCK = Block(
    name='delayed_motion',
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter('motion_delay', 's', 0.0, 0.0, LONGEST, 'Time before the command acts.', 1e-3),
    ),
    kernel=kernel,
    state_size=ring_size,
    description='Pure delay behind a moving mass, between ticks by a polynomial of fifth order.',
    source='bus, converter and driver latency',
)

EFFECTS = (
    replace(
        DELAYS[0],
        variant='delayed_motion',
        block=BLOCK,
        requires=_MOVING,
        neutral={'motion_delay': 0.0},
        start={'motion_delay': 5e-4},
        alternatives=({'motion_delay': 4e-3},),
    ),
)
