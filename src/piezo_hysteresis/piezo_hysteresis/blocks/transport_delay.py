"""Transport delay of the voltage."""

from math import ceil

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit

LONGEST = 0.1  # s
_ROUNDING = 1e-9  # tolerance of whole ticks, as a share of a tick


@jit
def in_ticks(delay: float, dt: float) -> tuple[int, float]:
    """Return the whole ticks in `delay` [s] and the remaining part of a tick, 0..1."""
    whole = int(delay / dt + _ROUNDING)
    return whole, min(max(delay / dt - whole, 0.0), 1.0)


@jit
def shift(x: FloatArray, y: FloatArray, state: FloatArray, ticks: int) -> None:
    """Return `x` delayed by `ticks`; state is the write index and a ring buffer of past values."""
    length = state.size - 1
    place = int(state[0])
    for k in range(x.size):
        state[1 + place] = x[k]
        older = place - ticks
        y[k] = state[1 + (older if older >= 0 else older + length)]
        place = place + 1 if place + 1 < length else 0
    state[0] = place


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the delayed voltage at the end of each tick; state is that of `shift` [V].

    A held voltage delayed by a part of a tick has arrived at the end of the tick.
    """
    shift(x, y, state, in_ticks(p[0], dt)[0])


def ring_size(dt: float) -> int:
    """Return the size of the ring buffer for the longest delay."""
    return ceil(LONGEST / dt) + 4


BLOCK = Block(
    name='transport_delay',
    slot=Slot.INPUT,
    parameters=(
        Parameter('delay', 's', 0.0, 0.0, LONGEST, 'Time before the command acts.', 1e-3),
    ),
    kernel=kernel,
    state_size=ring_size,
    description='Pure delay of the command, fractions of a sample included.',
    source='bus, converter and driver latency',
    between=InterSample.DELAY,
)

EFFECTS = (
    Effect(
        name='transport_delay',
        block=BLOCK,
        neutral={'delay': 0.0},
        starts=({'delay': 2e-3}, {'delay': 5e-4}, {'delay': 5e-3}),
        physics=(
            'Bus, converter or driver delay the command: the phase lag grows in proportion '
            'to the frequency at unchanged amplitude.'
        ),
        experiment=(
            'Phase over frequency up to some 100 Hz: linear for a delay, bending to 90 degrees '
            'with falling gain for a lag.'
        ),
        required_coverage=(Coverage.FAST, Coverage.WIDE),
        mistaken_for=('amplifier_lag', 'resonance', 'creep', 'hysteresis_exponent'),
    ),
)
