"""Bouc-Wen hysteresis by the papers' forward Euler step."""

from piezo_hysteresis.blocks._bouc_wen import PARAMETERS, check, run_of
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import inline_jit


@inline_jit
def euler_step(h: float, du: float, a: float, a0: float, beta: float, gamma: float) -> float:
    """Return h [m] after the voltage moved by `du` [V]."""
    rise = abs(du)
    return h + (a * du + a0 * rise - gamma * abs(h) * du - beta * rise * h)


kernel = run_of(euler_step)

BLOCK = Block(
    name='bouc_wen',
    part=InverseRole.EULER,
    slot=Slot.HYSTERESIS,
    parameters=PARAMETERS,
    kernel=kernel,
    state_size=2,
    between=InterSample.PATH,
    unknown=(1,),
    step_bound=True,
    description='Bouc-Wen hysteresis, forward Euler: the step that the papers print.',
    source='Fujii 2018 (2), (3) with gamma |h| du for the misprinted gamma |h| |du|; Tatebatake '
    '2017 (4), (5), (6), (18)',
    check=check,
)

EFFECTS = (
    Effect(
        name='asymmetry',
        variant='A0',
        block=None,
        frees=('A0',),
        neutral={'A0': 0.0},
        start={'A0': 2e-6},
        alternatives=({'A0': -2e-6},),
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
)
