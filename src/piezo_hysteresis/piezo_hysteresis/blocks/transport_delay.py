"""Time that passes before a command acts."""

from math import ceil

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit

LONGEST = 0.1  # s


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the delayed voltage; state is the place to write and a ring of past voltages [V].

    A delay between two samples gives the mean over the sample of the held voltage, which is linear
    interpolation.
    """
    length = state.size - 1
    shift = p[0] / dt
    whole = int(shift)
    part = shift - whole
    place = int(state[0])
    for k in range(x.size):
        state[1 + place] = x[k]
        newer = place - whole
        if newer < 0:
            newer += length
        older = newer - 1 if newer > 0 else length - 1
        y[k] = state[1 + newer] + part * (state[1 + older] - state[1 + newer])
        place = place + 1 if place + 1 < length else 0
    state[0] = place


def state_size(dt: float) -> int:
    """Return room for the longest delay."""
    return ceil(LONGEST / dt) + 4


BLOCK = Block(
    name='transport_delay',
    slot=Slot.INPUT,
    parameters=(
        Parameter('delay', 's', 0.0, 0.0, LONGEST, 'Time before the command acts.', 1e-3),
    ),
    kernel=kernel,
    state_size=state_size,
    description='Pure delay of the command, fractions of a sample included.',
    source='bus, converter and driver latency',
)

EFFECTS = (
    Effect(
        name='transport_delay',
        variant='transport_delay',
        block=BLOCK,
        neutral={'delay': 0.0},
        start={'delay': 5e-4},
        alternatives=({'delay': 4e-3},),
        physics=(
            'Bus, converter or driver hand the command on late: the phase lag grows in proportion '
            'to the frequency at unchanged amplitude.'
        ),
        experiment=(
            'Phase over frequency up to some 100 Hz: linear for a delay, bending to 90 degrees '
            'with falling gain for a lag.'
        ),
        mistaken_for=('amplifier_lag', 'resonance', 'creep', 'hysteresis_exponent'),
    ),
)
