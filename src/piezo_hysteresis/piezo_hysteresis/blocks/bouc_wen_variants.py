"""Bouc-Wen hysteresis with an exponent, and with a dependence on the rate of the voltage."""

from piezo_hysteresis.blocks._bouc_wen import (
    PARAMETERS,
    check,
    decaying_kernel,
    euler_step,
    exact_step,
    power_euler_kernel,
    power_kernel,
    widening_kernel,
)
from piezo_hysteresis.blocks.base import Along, Block, InterSample, Kernel, Parameter, Slot
from piezo_hysteresis.blocks.bouc_wen import RATE_PARAMETERS
from piezo_hysteresis.blocks.effect import Coverage, Effect

_EXPONENT = Parameter(
    'exponent', '1', 1.0, 0.5, 10.0,
    'Exponent n; large ones keep h linear until it saturates abruptly.',
)  # fmt: skip
_MEMORY = 'Time constant of the filtered rate.'
_WIDENING = (
    Parameter('widening', '1', 0.0, -0.05, 2.0, 'Growth of h per e-fold of rate.', 0.05),
    Parameter(
        'widening_corner', 'V/s', 5.0, 1e-3, 1e12, 'Rate of the voltage where it sets in.', 5.0
    ),
    Parameter('widening_memory', 's', 0.0, 0.0, 10.0, _MEMORY, 5e-3),
)
_POWER_WIDENING = (
    Parameter('power_widening', '1', 0.0, -0.5, 10.0, 'Growth of h at power_reference.', 0.1),
    Parameter(
        'power_reference', 'V/s', 100.0, 1e-3, 1e12, 'Rate of the voltage it refers to.', 100.0
    ),
    Parameter('widening_power', '1', 0.5, 0.05, 2.0, 'Power of the rate.', 0.5),
    Parameter('power_memory', 's', 0.0, 0.0, 10.0, _MEMORY, 5e-3),
)


def _block(
    name: str,
    more: tuple[Parameter, ...],
    description: str,
    source: str,
    *,
    kernel: Kernel | None = None,
    path_kernel: Along | None = None,
) -> Block:
    """Return a hysteresis with `more` parameters; without a kernel it depends on the rate."""
    return Block(
        name=name,
        slot=Slot.HYSTERESIS,
        parameters=(*PARAMETERS, *more),
        kernel=kernel,
        path_kernel=path_kernel,
        state_size=2 if kernel is not None else 3,
        between=InterSample.PATH,
        unknown=(1,) if kernel is not None else (1, 2),
        description=f'Bouc-Wen hysteresis{description}',
        source=source,
        check=check,
    )


_OF_EXPONENT = (
    ' of exponent n; h is referred to its saturation, (A + |A0|)/(beta + gamma), so that beta and '
    'gamma keep their unit and the loop its height for every n.'
)
_OF_RATE = (
    '; beta and gamma are multiplied by (1 + |du/dt|/rate_corner)^rate_exponent, the rate '
    'smoothed over rate_memory.'
)

POWERS = (
    _block(
        'bouc_wen_power',
        (_EXPONENT,),
        _OF_EXPONENT,
        'Tatebatake 2017 (1), Zhou 2021 (1): beta_paper = beta h_sat^(1-n), gamma_paper likewise',
        kernel=power_kernel,
    ),
    _block(
        'bouc_wen_power_euler',
        (_EXPONENT,),
        f'{_OF_EXPONENT} Forward Euler step.',
        'Zhou 2021 (1), Fujii 2018 (3)',
        kernel=power_euler_kernel,
    ),
)
RATES = (
    _block(
        'bouc_wen_rate',
        RATE_PARAMETERS,
        _OF_RATE,
        'our reading of Fang 2019: constant below a corner, dependent on the rate above it',
        path_kernel=decaying_kernel(exact_step),
    ),
    _block(
        'bouc_wen_rate_euler',
        RATE_PARAMETERS,
        f'{_OF_RATE} Forward Euler step.',
        'as bouc_wen_rate, with the step of Fujii 2018 (3)',
        path_kernel=decaying_kernel(euler_step),
    ),
)
LOGARITHM = _block(
    'bouc_wen_widening',
    _WIDENING,
    '; h is multiplied by 1 + widening log(1 + |du/dt|/widening_corner), the rate smoothed over '
    'widening_memory.',
    'coercive field of ferroelectrics, which grows with the logarithm of the field rate',
    path_kernel=widening_kernel(7),
)
POWER = _block(
    'bouc_wen_power_widening',
    _POWER_WIDENING,
    '; h is multiplied by 1 + power_widening (|du/dt|/power_reference)^widening_power, the rate '
    'smoothed over power_memory.',
    'coercive field of ferroelectrics over frequency (Ishibashi and Orihara): a power law',
    path_kernel=widening_kernel(8),
)

BLOCKS = (*POWERS, *RATES, LOGARITHM, POWER)

_REPLACED = ('bouc_wen_exact', 'bouc_wen')
_WIDER = (
    'Triangles of the same travel at rates of 1, 10, 100 V/s: with a logarithm the '
    'loop width grows by equal steps, with a power by equal factors.'
)
_LIKE_WIDER = ('amplifier_lag', 'transport_delay', 'creep', 'resonance')

EFFECTS = (
    *(
        Effect(
            name='hysteresis_exponent',
            block=block,
            replaces=(replaced,),
            neutral={'exponent': 1.0},
            starts=({'exponent': 1.5}, {'exponent': 0.8}, {'exponent': 3.0}),
            physics=(
                'The hysteretic share does not saturate exponentially: domains switch later and '
                'more abruptly (n > 1) or earlier (n < 1) than the exponent 1 of the model '
                'predicts.'
            ),
            experiment=(
                'An amplitude ladder at one frequency: the loop width over amplitude bends with n.'
            ),
            required_coverage=(Coverage.LADDER, Coverage.REVERSALS),
            mistaken_for=('nonlocal_memory', 'friction', 'stiffness'),
        )
        for block, replaced in zip(POWERS, _REPLACED, strict=True)
    ),
    *(
        Effect(
            name='rate_dependence',
            block=block,
            replaces=(replaced,),
            inexactness=0.07,  # one rate law represents those of many relaxations
            neutral={'rate_exponent': 0.0},
            starts=(
                {'rate_corner': 10.0, 'rate_exponent': 0.3, 'rate_memory': 2e-3},
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
        for block, replaced in zip(RATES, _REPLACED, strict=True)
    ),
    Effect(
        name='rate_dependence',
        block=LOGARITHM,
        replaces=('bouc_wen_exact',),
        inexactness=0.07,  # one law of the rate stands for those of many relaxations
        neutral={'widening': 0.0},
        starts=(
            {'widening': 0.05, 'widening_corner': 5.0, 'widening_memory': 3e-3},
            {'widening_corner': 50.0, 'widening': 0.1},
            {'widening_corner': 0.5, 'widening_memory': 1e-2},
        ),
        physics=(
            'The coercive field grows with the logarithm of the voltage rate, so the loop '
            'widens and keeps its shape.'
        ),
        experiment=_WIDER,
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=_LIKE_WIDER,
    ),
    Effect(
        name='rate_dependence',
        block=POWER,
        replaces=('bouc_wen_exact',),
        inexactness=0.07,  # one law of the rate stands for those of many relaxations
        holds={'power_reference': 100.0},
        neutral={'power_widening': 0.0},
        starts=(
            {'power_widening': 0.1, 'widening_power': 0.5, 'power_memory': 3e-3},
            {'widening_power': 0.2},
            {'widening_power': 1.0, 'power_memory': 1e-2},
        ),
        physics=(
            'The coercive field grows with a power of the voltage rate, so the loop widens '
            'and keeps its shape.'
        ),
        experiment=_WIDER,
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=_LIKE_WIDER,
    ),
)
