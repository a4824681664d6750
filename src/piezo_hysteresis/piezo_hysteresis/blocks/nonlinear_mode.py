"""Mode with a nonlinear spring and friction in its guidance."""

from dataclasses import replace
from math import inf, pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import _friction_mode
from piezo_hysteresis.blocks._friction_mode import friction_state, spring
from piezo_hysteresis.blocks.base import Between, Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.jit import jit


def pace(p: FloatArray) -> float:
    """Return the angular frequency of the linear mode [rad/s]."""
    return 2.0 * pi * float(p[0])


@jit
def restoring(
    p: FloatArray, x: float, before: float, memory: float, dt: float
) -> tuple[float, float]:
    """Return the force of spring and friction at `x` [m], and the bristle state there."""
    if p[3] > 0.0 and x != before:
        memory = friction_state(memory, x - before, dt, p[4], p[5], p[6])
    return spring(x, p[2], inf) + p[3] * memory, memory


BLOCK = Block(
    name='nonlinear_mode',
    restoring=restoring,
    slot=Slot.STRUCTURE,
    parameters=(
        *MODE.parameters,
        Parameter(
            'mode_cubic',
            '1/m^2',
            0.0,
            -1e14,
            1e14,
            'Cubic over linear stiffness; positive hardens.',
            1e6,
        ),
        Parameter('mode_friction', 'm', 0.0, 0.0, 1.0, 'Friction force over stiffness.', 1e-6),
        Parameter(
            'presliding',
            'm',
            1e-6,
            1e-10,
            1.0,
            'Displacement after which the friction is fully developed.',
            1e-6,
        ),
        Parameter('breakaway', '1', 1.0, 1.0, 5.0, 'Friction at rest over that when fast.', 0.1),
        Parameter(
            'stribeck_speed',
            'm/s',
            1e-3,
            1e-9,
            10.0,
            'Speed above which the friction decreases.',
            1e-3,
        ),
    ),
    kernel=_friction_mode.kernel,
    state_size=3,
    between=Between.INNER,
    unknown=(0, 1, 2),
    inertia=True,
    along=_friction_mode.along,
    pace=pace,
    description=(
        "x''/w^2 + 2 zeta x'/w + x + mode_cubic x^3 + mode_friction b = v, b after Dahl, or "
        'with a breakaway above 1 after LuGre; a softening spring goes slack, never outwards.'
    ),
    source='Zhou 2021 (3) with a Duffing spring and Dahl or LuGre friction',
)

_EXPERIMENTS = {
    'stiffness': (
        'An amplitude ladder and a sweep up and down through the resonance: the third harmonic '
        'grows with the cube, the resonance moves with the amplitude.'
    ),
    'friction': (
        'A small-amplitude record: friction keeps its size in metres, so the loop is widest '
        'and the resonance most damped at small amplitudes.'
    ),
}
_PHYSICS = {
    'stiffness': (
        'The guidance or the load is a spring whose stiffness changes with the displacement; its '
        'force acts back on the moving mass.'
    ),
    'friction': (
        'The moving mass rubs on its guidance: the force reverses over a short presliding '
        'distance and acts back on the mode.'
    ),
}
_MISTAKEN = {
    'stiffness': ('hysteresis_exponent', 'saturation', 'sensor_nonlinearity', 'odd_harmonic'),
    'friction': ('nonlocal_memory', 'hysteresis_exponent', 'hysteresis'),
}
_OWN = {'stiffness': {'mode_cubic': 1e6}, 'friction': {'mode_friction': 1e-6, 'presliding': 2e-6}}
_ALTERNATIVES = {
    'stiffness': ({'mode_cubic': -1e6},),
    # from a larger distance a fit converges to a force that reverses immediately
    'friction': ({'presliding': 5e-7},),
}
_NEUTRAL = {'stiffness': {'mode_cubic': 0.0}, 'friction': {'mode_friction': 0.0}}
_DAHL = {'breakaway': 1.0, 'stribeck_speed': 1e-3}
_HOLDS = {
    'stiffness': {'mode_friction': 0.0, 'presliding': 1e-6, **_DAHL},
    'friction': {'mode_cubic': 0.0, **_DAHL},
}

_IN_MODE = {
    name: Effect(
        name=name,
        variant='in_mode',
        block=BLOCK,
        replaces=('mode',),
        inexactness=0.07,  # Dahl's loop and a cubic spring approximate contacts of many kinds
        holds=_HOLDS[name],
        neutral=_NEUTRAL[name],
        start=_OWN[name],
        alternatives=_ALTERNATIVES[name],
        physics=_PHYSICS[name],
        experiment=_EXPERIMENTS[name],
        mistaken_for=_MISTAKEN[name],
    )
    for name in ('stiffness', 'friction')
}

EFFECTS = (
    *_IN_MODE.values(),
    replace(
        _IN_MODE['friction'],
        variant='breaking_away',
        inexactness=0.02,
        holds={'mode_cubic': 0.0},
        start={**_OWN['friction'], 'breakaway': 1.2, 'stribeck_speed': 1e-3},
    ),
    *(
        replace(
            effect,
            variant='in_nonlinear_mode',
            block=None,
            replaces=(),
            holds={},
            frees=tuple(_OWN[name]),
            requires=('nonlinear_mode',),
        )
        for name, effect in _IN_MODE.items()
    ),
)
