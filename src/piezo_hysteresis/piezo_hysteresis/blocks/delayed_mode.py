"""A mode whose drive comes late by any fraction of a sample: a delayed command before a mode."""

from math import pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.blocks.transport_delay import EFFECTS as DELAYS
from piezo_hysteresis.blocks.transport_delay import LONGEST, state_size
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the position to a held drive that acts `p[2]` seconds late.

    Within a sample the drive steps once from an older value to the next: two holds, one after the
    other. State is (position [m], velocity [m/s], place to write, ring of past drives [m]).
    """
    omega = 2.0 * pi * p[0]
    shift = p[2] / dt
    whole = int(shift)
    part = shift - whole
    a11, a12, a21, a22 = hold(omega, p[1], part * dt)
    b11, b12, b21, b22 = hold(omega, p[1], (1.0 - part) * dt)
    position, velocity, place = state[0], state[1], int(state[2])
    length = state.size - 3
    for k in range(x.size):
        y[k] = position
        state[3 + place] = x[k]
        at = place - whole
        if at < 0:
            at += length
        newer, older = state[3 + at], state[3 + (at - 1 if at > 0 else length - 1)]
        swing = position - older
        moved, speed = a11 * swing + a12 * velocity, a21 * swing + a22 * velocity
        swing = older + moved - newer
        position = newer + b11 * swing + b12 * speed
        velocity = b21 * swing + b22 * speed
        place = place + 1 if place + 1 < length else 0
    state[0] = position
    state[1] = velocity
    state[2] = place


def ring_size(dt: float) -> int:
    """Return room for the mode and the longest delay."""
    return 2 + state_size(dt)


BLOCK = Block(
    name='delayed_mode',
    slot=Slot.STRUCTURE,
    parameters=(
        *MODE.parameters,
        Parameter('mode_delay', 's', 0.0, 0.0, LONGEST, 'Time before the drive acts.', 1e-3),
    ),
    kernel=kernel,
    state_size=ring_size,
    description='One mode of unit DC gain, exact for a held drive that acts late.',
    source='002 (3) behind bus, converter and driver latency',
)

_LIKE = DELAYS[0]

EFFECTS = (
    Effect(
        name='transport_delay',
        variant='delayed_mode',
        block=BLOCK,
        replaces=('mode',),
        neutral={'mode_delay': 0.0},
        start={'mode_delay': 5e-4},
        alternatives=({'mode_delay': 4e-3},),
        physics=_LIKE.physics,
        experiment=_LIKE.experiment,
        mistaken_for=_LIKE.mistaken_for,
    ),
)
