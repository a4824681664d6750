"""Bouc-Wen hysteresis with a loop that widens with the logarithm or a power of the rate."""

from math import log1p

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import PARAMETERS, check
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.bouc_wen_rate import filtered_rate
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit


@inline_jit
def respond_widened(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, memory: float,
    power: float, points: int,
) -> None:  # fmt: skip
    """Return ``A1 u - w h``, with w from a power of the rate, or its logarithm if the power is 0.

    State is (last voltage [V], h [m], filtered rate [V/s]); the rate is that of the tick.
    """
    a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
    last, h, rate = state[0], state[1], state[2]
    for tick in range(0, x.size, points):
        rate = filtered_rate(rate, x[tick + points - 1] - last, dt, memory)
        growth = (rate / p[6]) ** power if power > 0.0 else log1p(rate / p[6])
        for k in range(tick, tick + points):
            h = exact_step(h, x[k] - last, a, a0, beta, gamma)
            last = x[k]
            y[k] = a1 * last - (1.0 + p[5] * growth) * h
    state[0] = last
    state[1] = h
    state[2] = rate


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Widen with the logarithm of the rate."""
    respond_widened(x, y, state, p, dt, p[7], 0.0, points)


@jit
def power_along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Widen with a power of the rate."""
    respond_widened(x, y, state, p, dt, p[8], p[7], points)


_LOGARITHM = Block(
    name='bouc_wen_widening',
    slot=Slot.HYSTERESIS,
    parameters=(
        *PARAMETERS,
        Parameter('widening', '1', 0.0, -0.05, 2.0, 'Growth of h per e-fold of rate.', 0.05),
        Parameter(
            'widening_corner', 'V/s', 5.0, 1e-3, 1e12, 'Rate of the voltage where it sets in.', 5.0
        ),
        Parameter(
            'widening_memory', 's', 0.0, 0.0, 10.0, 'Time constant of the filtered rate.', 5e-3
        ),
    ),
    state_size=3,
    between=InterSample.PATH,
    unknown=(1, 2),
    path_kernel=along,
    description=(
        'Bouc-Wen hysteresis; h is multiplied by 1 + widening log(1 + |du/dt|/widening_corner), '
        'the rate smoothed over widening_memory.'
    ),
    source='coercive field of ferroelectrics, which grows with the logarithm of the field rate',
    check=check,
)  # fmt: skip

_POWER = Block(
    name='bouc_wen_power_widening',
    slot=Slot.HYSTERESIS,
    parameters=(
        *PARAMETERS,
        Parameter(
            'power_widening', '1', 0.0, -0.5, 10.0, 'Growth of h at power_reference.', 0.1
        ),
        Parameter(
            'power_reference', 'V/s', 100.0, 1e-3, 1e12, 'Rate of the voltage it refers to.', 100.0
        ),
        Parameter('widening_power', '1', 0.5, 0.05, 2.0, 'Power of the rate.', 0.5),
        Parameter(
            'power_memory', 's', 0.0, 0.0, 10.0, 'Time constant of the filtered rate.', 5e-3
        ),
    ),
    state_size=3,
    between=InterSample.PATH,
    unknown=(1, 2),
    path_kernel=power_along,
    description=(
        'Bouc-Wen hysteresis; h is multiplied by 1 + power_widening '
        '(|du/dt|/power_reference)^widening_power, the rate smoothed over power_memory.'
    ),
    source='coercive field of ferroelectrics over frequency (Ishibashi and Orihara): a power law',
    check=check,
)  # fmt: skip

_EXPERIMENT = (
    'Triangles of the same travel at rates of 1, 10, 100 V/s: with a logarithm the '
    'loop width grows by equal steps, with a power by equal factors.'
)
_MISTAKEN = ('amplifier_lag', 'transport_delay', 'creep', 'resonance')

BLOCKS = (_LOGARITHM, _POWER)

EFFECTS = (
    Effect(
        name='rate_dependence',
        variant='bouc_wen_widening',
        block=_LOGARITHM,
        replaces=('bouc_wen_exact',),
        inexactness=0.07,  # one law of the rate stands for those of many relaxations
        neutral={'widening': 0.0},
        start={'widening': 0.05, 'widening_corner': 5.0, 'widening_memory': 3e-3},
        alternatives=(
            {'widening_corner': 50.0, 'widening': 0.1},
            {'widening_corner': 0.5, 'widening_memory': 1e-2},
        ),
        physics=(
            'The coercive field grows with the logarithm of the voltage rate, so the loop '
            'widens and keeps its shape.'
        ),
        experiment=_EXPERIMENT,
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=_MISTAKEN,
    ),
    Effect(
        name='rate_dependence',
        variant='bouc_wen_power_widening',
        block=_POWER,
        replaces=('bouc_wen_exact',),
        inexactness=0.07,  # one law of the rate stands for those of many relaxations
        holds={'power_reference': 100.0},
        neutral={'power_widening': 0.0},
        start={'power_widening': 0.1, 'widening_power': 0.5, 'power_memory': 3e-3},
        alternatives=({'widening_power': 0.2}, {'widening_power': 1.0, 'power_memory': 1e-2}),
        physics=(
            'The coercive field grows with a power of the voltage rate, so the loop widens '
            'and keeps its shape.'
        ),
        experiment=_EXPERIMENT,
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=_MISTAKEN,
    ),
)
