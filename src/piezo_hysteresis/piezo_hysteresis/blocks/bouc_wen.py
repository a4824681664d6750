"""Bouc-Wen hysteresis: by the papers' Euler step, by its exact step, and modified by Fang 2019."""

from collections.abc import Mapping

from piezo_hysteresis.blocks._bouc_wen import (
    PARAMETERS,
    check,
    euler_step,
    exact_step,
    modified_along,
    steady_kernel,
)
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect

RATE_PARAMETERS = (
    Parameter(
        'rate_corner', 'V/s', 10.0, 1e-3, 1e12,
        'Rate of the voltage below which the hysteresis does not depend on it.', 10.0,
    ),
    Parameter(
        'rate_exponent', '1', 0.0, -1.5, 1.5,
        'Power of the rate by which the decay of h grows far above the corner.', 0.3,
    ),
    Parameter(
        'rate_memory', 's', 0.0, 0.0, 10.0,
        'Time constant of the filtered rate, so that it does not vanish at every reversal.', 5e-3,
    ),
)  # fmt: skip
_BENT = (
    Parameter(
        'epsilon', 'm/V^2', 0.0, -1e-2, 1e-2,
        'Growth of h with the length of the travel in proportion to the voltage above the bias: '
        'bends the loop.', 1e-5,
    ),
    Parameter(
        'bias', 'V', 0.0, -1e4, 1e4,
        'Voltage about which the bend is symmetrical (lambda in Fang 2019).', 0.1,
    ),
)  # fmt: skip

EULER = Block(
    name='bouc_wen',
    role=InverseRole.EULER,
    slot=Slot.HYSTERESIS,
    parameters=PARAMETERS,
    kernel=steady_kernel(euler_step),
    state_size=2,
    between=InterSample.PATH,
    unknown=(1,),
    description='Bouc-Wen hysteresis, forward Euler: the step that the papers print.',
    source='Fujii 2018 (2), (3) with gamma |h| du for the misprinted gamma |h| |du|; Tatebatake '
    '2017 (4), (5), (6), (18)',
    check=check,
)

exact_kernel = steady_kernel(exact_step)

EXACT = Block(
    name='bouc_wen_exact',
    role=InverseRole.EXACT,
    slot=Slot.HYSTERESIS,
    parameters=PARAMETERS,
    kernel=exact_kernel,
    state_size=2,
    between=InterSample.PATH,
    unknown=(1,),
    description='Bouc-Wen hysteresis, exact for a voltage that is monotone between two samples.',
    source='Fujii 2018 (1), Tatebatake 2017 (2), (3), (17), Zhou 2021 (2), (6), Xiao 2014 (1), '
    'Fang 2019 (classical model); exact step for exponent 1',
    check=check,
)


def _check_bent(values: Mapping[str, float]) -> str:
    """Return '' or the reason why h is unbounded for these values."""
    if values['beta'] == 0.0 and values['epsilon'] != 0.0:
        return 'epsilon without decay (beta = 0) grows without bound; set beta > 0 or epsilon = 0'
    return ''


MODIFIED = Block(
    name='bouc_wen_modified',
    slot=Slot.HYSTERESIS,
    parameters=(*(q for q in PARAMETERS if q.name != 'A0'), *_BENT, *RATE_PARAMETERS),
    state_size=3,
    between=InterSample.PATH,
    unknown=(1, 2),
    path_kernel=modified_along,
    description=(
        'Bouc-Wen hysteresis with a bias term and a factor eta = (1 + |du/dt|/rate_corner)^'
        'rate_exponent on the whole growth of h.'
    ),
    source=(
        'Fang 2019 (9), which did not survive printing; our reading: x = k1 u + k2 + k3 h, dh = '
        'eta (alpha du - beta |du| h + gamma du |h| + epsilon (u - lambda) |du|), with A = -k3 '
        'alpha and gamma = -gamma_paper; k2 is the offset'
    ),
    check=_check_bent,
    role=InverseRole.MODIFIED,
)

BLOCKS = (EULER, EXACT, MODIFIED)

EFFECTS = (
    Effect(
        name='asymmetry',
        variant='A0',
        block=None,
        neutral={'A0': 0.0},
        starts=({'A0': 2e-6}, {'A0': -2e-6}),
        physics=(
            'Domains switch differently for rising and falling voltage (a preferred '
            'polarisation), so the loop drifts off centre until decay balances the growth.'
        ),
        experiment=(
            'The first seconds after the start and an amplitude step: asymmetry builds up '
            'with the travel of the voltage, an offset is present from the start.'
        ),
        mistaken_for=('offset', 'drift', 'electrostriction', 'creep'),
    ),
    Effect(
        name='hysteresis',
        variant='input',
        block=EXACT,
        replaces=('gain',),
        inexactness=0.07,  # one loop represents those of many domains
        holds={'A0': 0.0},
        neutral={'A': 0.0},
        starts=(
            {'A': 4e-5, 'beta': 2.0, 'gamma': 0.2},
            {'A': -4e-5},
            {'beta': 10.0, 'gamma': 1.0},
        ),
        physics=(
            'Domains of the ceramic switch with losses: the displacement lags behind the '
            'voltage by a share that depends on its history and not on its rate.'
        ),
        experiment=(
            'A slow triangle: at a tenth of the frequency the loop has the same width; that '
            'of a lag or delay is smaller.'
        ),
        mistaken_for=('friction', 'amplifier_lag', 'transport_delay', 'creep'),
    ),
)
