"""A mode whose spring is not linear and whose guidance rubs."""

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, exp, inf, pi, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.base import Between, Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.jit import jit

# Longest step [rad], and how many to a tick: rubbing turns round within a step.
_STRIDE = 0.25
_FEWEST = 4
_MOST_PARTS = 400
_BRIEF = 1e-6  # share of a step that is not worth one of its own


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
def spring(position: float, cubic: float, stiffest: float) -> float:
    """Return the cubic share of the restoring force, in metres of static displacement.

    Beyond ``1/sqrt(-cubic)`` a softening spring pushes outwards and the mode would never come
    back. There, and only there, it is slack instead: no force at all, so that a fit that strays
    there stays finite. A hardening one is followed up to `stiffest` times the linear stiffness.
    """
    return min(max(cubic * position * position, -1.0), stiffest) * position


@jit
def pull(
    x: float, v: float, begun: tuple[float, float], time: float, p: FloatArray, stiffest: float
) -> float:
    """Return the force that acts back at `x`, `time` after the bristles were at `begun`.

    `begun` is position and deflection at the start of the step; on the way they are told by the
    move since then, exactly as long as it goes one way.
    """
    force = spring(x, p[2], stiffest)
    if p[3] > 0.0:
        bristle = begun[1]
        if time > 0.0:
            bristle = rubbed(bristle, x - begun[0], time, p[4], p[5], p[6])
        force += p[3] * bristle
    return force


@jit
def advance(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    half: tuple[float, float, float, float],
    full: tuple[float, float, float, float],
    stiffest: float,
) -> None:
    """Move `state` on by `h` [s] with the input `f` at its start, middle and end.

    The linear part is exact, by its transition over half and the whole of the step; what the
    input does within the step and the forces that act back are carried by a Runge-Kutta scheme of
    fourth order in coordinates that move with the linear part (Lawson).
    """
    square = (2.0 * pi * p[0]) ** 2
    begun = (state[0], state[2])
    x, v = state[0] - f[1], state[1]
    a1 = square * (f[0] - f[1] - pull(state[0], v, begun, 0.0, p, stiffest))
    xh, vh = half[0] * x + half[1] * v, half[2] * x + half[3] * v
    x2, v2 = xh + 0.5 * h * half[1] * a1, vh + 0.5 * h * half[3] * a1
    a2 = -square * pull(x2 + f[1], v2, begun, 0.5 * h, p, stiffest)
    a3 = -square * pull(xh + f[1], vh + 0.5 * h * a2, begun, 0.5 * h, p, stiffest)
    xf, vf = full[0] * x + full[1] * v, full[2] * x + full[3] * v
    x4, v4 = xf + h * half[1] * a3, vf + h * half[3] * a3
    a4 = square * (f[2] - f[1] - pull(x4 + f[1], v4, begun, h, p, stiffest))
    moved = xf + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + f[1]
    state[1] = vf + h / 6.0 * (full[3] * a1 + 2.0 * half[3] * (a2 + a3) + a4)
    if p[3] > 0.0:
        state[2] = rubbed(state[2], moved - state[0], h, p[4], p[5], p[6])
    state[0] = moved


@jit
def turning(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    half: tuple[float, float, float, float],
    full: tuple[float, float, float, float],
    stiffest: float,
) -> None:
    """Move `state` on as `advance` does; where it rubs and turns round, in two parts.

    The force of the bristles has a corner there. The turn is where the velocity, as far as the
    whole step tells, runs through zero.
    """
    x, v, bristle = state[0], state[1], state[2]
    advance(f, state, p, h, half, full, stiffest)
    if p[3] == 0.0 or v * state[1] >= 0.0:
        return
    share = v / (v - state[1])
    if share < _BRIEF or share > 1.0 - _BRIEF:
        return
    state[0], state[1], state[2] = x, v, bristle
    omega = 2.0 * pi * p[0]
    slope, bend = -3.0 * f[0] + 4.0 * f[1] - f[2], 2.0 * (f[0] - 2.0 * f[1] + f[2])
    for begin, end in ((0.0, share), (share, 1.0)):
        middle, part = 0.5 * (begin + end), (end - begin) * h
        inside = (
            f[0] + begin * (slope + begin * bend),
            f[0] + middle * (slope + middle * bend),
            f[0] + end * (slope + end * bend),
        )
        first, both = hold(omega, p[1], 0.5 * part), hold(omega, p[1], part)
        advance(inside, state, p, part, first, both, stiffest)


@jit
def parts_of_a_tick(p: FloatArray, dt: float) -> int:
    """Return the steps per tick that the forces need: so many to a radian of the stiffest."""
    stiff = 1.0 + p[3] * p[5] / p[4]
    turned = 2.0 * pi * p[0] * dt * sqrt(stiff)
    return int(max(_FEWEST, min(ceil(min(turned / _STRIDE, 1e6)), _MOST_PARTS)))


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the position; state is (position [m], velocity [m/s], bristle)."""
    parts = parts_of_a_tick(p, dt)
    h = dt / parts
    half = hold(2.0 * pi * p[0], p[1], 0.5 * h)
    full = hold(2.0 * pi * p[0], p[1], h)
    stiffest = 1.0 / (2.0 * pi * p[0] * h) ** 2
    for k in range(x.size):
        y[k] = state[0]
        held = (x[k], x[k], x[k])
        for _ in range(parts):
            turning(held, state, p, h, half, full, stiffest)


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Answer the position along a path, three points to a step; state as in the kernel."""
    steps = points // 3
    middle = max(1, (parts_of_a_tick(p, dt) + 2 * steps - 1) // (2 * steps))
    parts = 2 * middle
    h = dt / (steps * parts)
    half = hold(2.0 * pi * p[0], p[1], 0.5 * h)
    full = hold(2.0 * pi * p[0], p[1], h)
    stiffest = 1.0 / (2.0 * pi * p[0] * h) ** 2
    for k in range(0, x.size, 3):
        slope = -3.0 * x[k] + 4.0 * x[k + 1] - x[k + 2]
        bend = 2.0 * (x[k] - 2.0 * x[k + 1] + x[k + 2])
        y[k] = state[0]
        for i in range(parts):
            t0, t1, t2 = i / parts, (i + 0.5) / parts, (i + 1) / parts
            f = (
                x[k] + t0 * (slope + t0 * bend),
                x[k] + t1 * (slope + t1 * bend),
                x[k] + t2 * (slope + t2 * bend),
            )
            turning(f, state, p, h, half, full, stiffest)
            if i + 1 == middle:
                y[k + 1] = state[0]
        y[k + 2] = state[0]


def pace(p: FloatArray) -> float:
    """Return the angular frequency of the linear mode [rad/s]."""
    return 2.0 * pi * float(p[0])


def restoring(
    values: Mapping[str, float], x: float, before: float, memory: float, dt: float
) -> tuple[float, float]:
    """Return what spring and friction add to the target at `x` [m], and the bristles there."""
    if values['mode_friction'] > 0.0 and x != before:
        memory = rubbed(
            memory,
            x - before,
            dt,
            values['presliding'],
            values['breakaway'],
            values['stribeck_speed'],
        )
    force = spring(x, values['mode_cubic'], inf) + values['mode_friction'] * memory
    return force, memory


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
            'presliding', 'm', 1e-6, 1e-10, 1.0, 'Move after which friction is fully up.', 1e-6
        ),
        Parameter('breakaway', '1', 1.0, 1.0, 5.0, 'Friction at rest over that when fast.', 0.1),
        Parameter(
            'stribeck_speed', 'm/s', 1e-3, 1e-9, 10.0, 'Speed from which friction is less.', 1e-3
        ),
    ),
    kernel=kernel,
    state_size=3,
    between=Between.INNER,
    unknown=(0, 1, 2),
    inertia=True,
    along=along,
    pace=pace,
    description=(
        "x''/w^2 + 2 zeta x'/w + x + mode_cubic x^3 + mode_friction b = v, b after Dahl, or "
        'with a breakaway above 1 after LuGre; a softening spring goes slack, never outwards.'
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
        inexactness=0.07,  # Dahl's loop and a cubic spring stand for contacts of many kinds
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
