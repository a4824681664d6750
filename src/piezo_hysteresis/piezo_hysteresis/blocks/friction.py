"""Dry friction in the structure: backlash (play) and stick-slip."""

from math import ceil

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._plays import play
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def backlash_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the output of a play; state is its last output [m]."""
    for k in range(x.size):
        state[0] = play(x[k], state[0], p[0])
        y[k] = state[0]


@jit
def stiction_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the position with stick-slip; state is the last position [m]."""
    for k in range(x.size):
        if abs(x[k] - state[0]) > p[0] or p[0] == 0.0:
            state[0] = x[k]
        y[k] = state[0]


@jit
def stiction_along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the position with stick-slip along a path; state is the last position [m].

    After a jump of the drive at a tick the position follows it completely; a continuous drive is
    followed in slips of the break-away distance.
    """
    reach = p[0]
    for k in range(x.size):
        ahead = x[k] - state[0]
        if k % points == 0 or reach == 0.0:
            if abs(ahead) > reach:
                state[0] = x[k]
        elif abs(ahead) > reach:
            slips = ceil(abs(ahead) / reach) - 1.0
            state[0] += slips * (reach if ahead > 0.0 else -reach)
        y[k] = state[0]


_BACKLASH = (
    'A joint or guidance with clearance or dry friction lets the drive move a fixed distance '
    'after each reversal before the output follows.'
)
_STICTION = (
    'Static friction holds the output until the drive has run ahead by a fixed distance; then it '
    'breaks away and catches up in a jump.'
)

BLOCKS = (
    Block(
        name='backlash',
        slot=Slot.STRUCTURE,
        parameters=(
            Parameter(
                'backlash',
                'm',
                0.0,
                0.0,
                1.0,
                'Half width of the play: how far the drive moves before the output follows.',
                2e-6,
            ),
        ),
        kernel=backlash_kernel,
        state_size=1,
        between=InterSample.PATH,
        description='Play between drive and output: friction against a soft drive.',
        source='Coulomb friction between a soft drive and the output, quasi-static',
    ),
    Block(
        name='stiction',
        slot=Slot.STRUCTURE,
        parameters=(
            Parameter(
                'stiction',
                'm',
                0.0,
                0.0,
                1.0,
                'How far the drive runs ahead before the output breaks away and catches up.',
                2e-6,
            ),
        ),
        kernel=stiction_kernel,
        state_size=1,
        between=InterSample.PATH,
        path_kernel=stiction_along,
        description='Stick-slip: the output sticks, then jumps to the drive.',
        source='Coulomb friction with break-away, quasi-static',
    ),
)

EFFECTS = tuple(
    Effect(
        name='friction',
        block=block,
        neutral={block.name: 0.0},
        starts=({block.name: 1e-6}, {block.name: 5e-6}),
        physics=physics,
        experiment=(
            'A small-amplitude record: the dead zone keeps its width in metres, so its share of '
            'the loop grows as the amplitude shrinks.'
        ),
        mistaken_for=('nonlocal_memory', 'hysteresis_exponent', 'hysteresis'),
    )
    for block, physics in zip(BLOCKS, (_BACKLASH, _STICTION), strict=True)
)
