"""A mode whose spring is not linear and whose guidance rubs."""

from dataclasses import replace
from math import exp, pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.jit import jit

# Steps per sample for the forces that act back: extrapolating them feeds energy into a mode that
# turns far within a step, so a fast mode gets more steps.
_PARTS = 8
_MOST_PARTS = 400


@jit
def rubbed(
    bristle: float, move: float, dt: float, presliding: float, breakaway: float, stribeck: float
) -> float:
    """Return the deflection of the bristles after a move within `dt` [s] (exact).

    It is -1 to 1 when fast (Dahl's law), `breakaway` times as much at rest (Stribeck's law).
    """
    limit = 1.0 if move > 0.0 else -1.0
    if breakaway > 1.0:
        limit *= 1.0 + (breakaway - 1.0) * exp(-((move / dt / stribeck) ** 2))
    return limit + (bristle - limit) * exp(-abs(move) / (presliding * abs(limit)))


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the position; the linear part is exact, the forces that act back are extrapolated.

    State is (position [m], velocity [m/s], bristle, last force [m]); forces are in metres of
    static displacement.
    """
    parts = min(_PARTS + int(_PARTS * 2.0 * pi * p[0] * dt), _MOST_PARTS)
    a11, a12, a21, a22 = hold(2.0 * pi * p[0], p[1], dt / parts)
    b1, b2 = 1.0 - a11, -a21
    position, velocity, bristle, force = state[0], state[1], state[2], state[3]
    for k in range(x.size):
        y[k] = position
        for _ in range(parts):
            # a softening spring keeps a fifth of its stiffness, so that it cannot fall over
            stretch = p[2] * position * position
            if stretch < 0.0:
                stretch = 0.8 * stretch / (0.8 - stretch)
            now = stretch * position + p[3] * bristle
            held = x[k] - (1.5 * now - 0.5 * force)
            force = now
            moved = a11 * position + a12 * velocity + b1 * held
            velocity = a21 * position + a22 * velocity + b2 * held
            if p[3] > 0.0:
                bristle = rubbed(bristle, moved - position, dt / parts, p[4], p[5], p[6])
            position = moved
    state[0] = position
    state[1] = velocity
    state[2] = bristle
    state[3] = force


BLOCK = Block(
    name='nonlinear_mode',
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
            'presliding', 'm', 1e-6, 1e-10, 1.0, 'Move after which friction is fully up.', 1e-6
        ),
        Parameter('breakaway', '1', 1.0, 1.0, 5.0, 'Friction at rest over that when fast.', 0.1),
        Parameter(
            'stribeck_speed', 'm/s', 1e-3, 1e-9, 10.0, 'Speed from which friction is less.', 1e-3
        ),
    ),
    kernel=kernel,
    state_size=4,
    description=(
        "x''/w^2 + 2 zeta x'/w + x + mode_cubic x^3 + mode_friction b = v, b after Dahl, or "
        'with a breakaway above 1 after LuGre.'
    ),
    source='002 (3) with a Duffing spring and Dahl or LuGre friction',
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
_OWN = {
    'stiffness': {'mode_cubic': 1e6},
    'friction': {'mode_friction': 1e-6, 'presliding': 2e-6},
}
_ALTERNATIVES = {
    'stiffness': ({'mode_cubic': -1e6},),
    # from further than the true distance a fit falls to a force that reverses at once
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
