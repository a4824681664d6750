"""Bouc-Wen hysteresis with a decay that depends on the rate of the voltage."""

from math import expm1
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import PARAMETERS, check
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.bouc_wen import euler_step
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit


@inline_jit
def filtered_rate(rate: float, du: float, dt: float, memory: float) -> float:
    """Return the rate of the voltage that acts on the domains [V/s]: low-pass filtered |du/dt|."""
    now = abs(du) / dt
    return now if memory == 0.0 else rate - (now - rate) * expm1(-dt / memory)


@inline_jit
def rate_factor(rate: float, corner: float, exponent: float) -> float:
    """Return ``(1 + rate/corner)^exponent``: 1 when slow, a power law when fast."""
    return 1.0 if exponent == 0.0 else float((1.0 + rate / corner) ** exponent)


def _along(step: Any) -> Any:
    """Return the kernel of a law with a rate-dependent decay, for its step function."""

    @jit
    def along(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float,
        frequency: float, points: int,
    ) -> None:  # fmt: skip
        """Return ``A1 u - h``; state is (last voltage [V], h [m], filtered rate [V/s]).

        The rate of a tick is the difference from the previous voltage over the interval.
        """
        a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
        last, h, rate = state[0], state[1], state[2]
        for tick in range(0, x.size, points):
            rate = filtered_rate(rate, x[tick + points - 1] - last, dt, p[7])
            factor = rate_factor(rate, p[5], p[6])
            for k in range(tick, tick + points):
                h = step(h, x[k] - last, a, a0, beta * factor, gamma * factor)
                last = x[k]
                y[k] = a1 * last - h
        state[0] = last
        state[1] = h
        state[2] = rate

    return along


RATE_PARAMETERS = (
    Parameter(
        'rate_corner',
        'V/s',
        10.0,
        1e-3,
        1e12,
        'Rate of the voltage below which the hysteresis does not depend on it.',
        10.0,
    ),
    Parameter(
        'rate_exponent',
        '1',
        0.0,
        -1.5,
        1.5,
        'Power of the rate by which the decay of h grows far above the corner.',
        0.3,
    ),
    Parameter(
        'rate_memory',
        's',
        0.0,
        0.0,
        10.0,
        'Time constant of the filtered rate, so that it does not vanish at every reversal.',
        5e-3,
    ),
)
_DESCRIPTION = (
    'Bouc-Wen hysteresis; beta and gamma are multiplied by '
    '(1 + |du/dt|/rate_corner)^rate_exponent, the rate smoothed over rate_memory.'
)

BLOCKS = (
    Block(
        name='bouc_wen_rate',
        slot=Slot.HYSTERESIS,
        parameters=(*PARAMETERS, *RATE_PARAMETERS),
        state_size=3,
        between=InterSample.PATH,
        unknown=(1, 2),
        path_kernel=_along(exact_step),
        description=_DESCRIPTION,
        source='our reading of Fang 2019: constant below a corner, dependent on the rate above it',
        check=check,
    ),
    Block(
        name='bouc_wen_rate_euler',
        slot=Slot.HYSTERESIS,
        parameters=(*PARAMETERS, *RATE_PARAMETERS),
        state_size=3,
        between=InterSample.PATH,
        unknown=(1, 2),
        path_kernel=_along(euler_step),
        step_bound=True,
        description=f'{_DESCRIPTION} Forward Euler step.',
        source='as bouc_wen_rate, with the step of Fujii 2018 (3)',
        check=check,
    ),
)

EFFECTS = tuple(
    Effect(
        name='rate_dependence',
        variant=block.name,
        block=block,
        replaces=(replaced,),
        inexactness=0.07,  # one rate law represents those of many relaxations
        neutral={'rate_exponent': 0.0},
        start={'rate_corner': 10.0, 'rate_exponent': 0.3, 'rate_memory': 2e-3},
        alternatives=(
            {'rate_exponent': -0.3},
            {'rate_corner': 100.0, 'rate_exponent': 1.0},
            {'rate_corner': 1.0, 'rate_exponent': 0.1},
        ),
        physics=(
            'Domains need time to switch, so the width of the loop itself depends on how fast '
            'the voltage moves, beyond what inertia, delay and lag explain.'
        ),
        experiment=(
            'Triangles of the same travel at other rates: a lag shifts the loop along the '
            'voltage in proportion to the rate, rate dependence changes the width of its tips.'
        ),
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=('creep', 'amplifier_lag', 'transport_delay', 'resonance'),
    )
    for block, replaced in zip(BLOCKS, ('bouc_wen_exact', 'bouc_wen'), strict=True)
)
