"""Kernels of a mode with a nonlinear spring and friction in its guidance."""

from dataclasses import replace
from math import ceil, exp, inf, pi, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.base import Block, InnerMode, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.jit import inline_jit, jit

# Longest step [rad], and limits of the steps per tick: friction may reverse within a step.
_STRIDE = 0.25
_FEWEST = 4
_MOST_PARTS = 400
_BRIEF = 1e-6  # share of a step below which it is not divided
# Motion within a step, relative to the presliding length, below which a reversal has no effect.
# At rest the velocity is a rounding error, and so is the derivative of the time of its reversal.
_STILL = 1e-8

Transition = tuple[float, float, float, float]
"""Transition of position and velocity over a time, (a11, a12, a21, a22), see `hold`."""
Triple = tuple[float, float, float]
"""Position, velocity and bristles, or the input at start, middle and end of a step."""
Law = tuple[float, float, float, float, float, float, float, float]
"""The parameters of the block, and the limit of the stiffness over the linear one."""


@inline_jit
def law_of(p: FloatArray, h: float) -> Law:
    """Return the coefficients of the law for steps of `h` [s].

    They are scalars and not an array: the compiler keeps them in registers, which is 4 times
    faster.
    """
    stiffest = 1.0 / (2.0 * pi * p[0] * h) ** 2
    return p[0], p[1], p[2], p[3], p[4], p[5], p[6], stiffest


@inline_jit
def transitions(law: Law, h: float) -> tuple[Transition, Transition]:
    """Return the transitions of the linear mode over half a step of `h` [s] and a whole step."""
    omega = 2.0 * pi * law[0]
    return hold(omega, law[1], 0.5 * h), hold(omega, law[1], h)


@jit
def friction_state(
    bristle: float, move: float, dt: float, presliding: float, breakaway: float, stribeck: float
) -> float:
    """Return the deflection of the bristles after a move within `dt` [s] (exact).

    It is -1 to 1 when fast (Dahl's law), `breakaway` times as much at rest (Stribeck's law).
    """
    # at rest the generated derivative of the absolute value is that of a positive move
    limit = 1.0 if move >= 0.0 else -1.0
    if breakaway > 1.0:
        limit *= 1.0 + (breakaway - 1.0) * exp(-((move / dt / stribeck) ** 2))
    return limit + (bristle - limit) * exp(-abs(move) / (presliding * abs(limit)))


@inline_jit
def spring(position: float, cubic: float, stiffest: float) -> float:
    """Return the cubic share of the restoring force, in metres of static displacement.

    Beyond ``1/sqrt(-cubic)`` a softening spring is unstable. Its force is zero there, so that a
    fit remains finite. A hardening spring is limited to `stiffest` times the linear stiffness.
    """
    return min(max(cubic * position * position, -1.0), stiffest) * position


@inline_jit
def pull(x: float, initial: Triple, time: float, law: Law) -> float:
    """Return the restoring force at `x`, `time` after the mode was at `initial`.

    The bristle state follows from the move since then, exactly as long as its direction is
    constant.
    """
    force = spring(x, law[2], law[7])
    if law[3] > 0.0:
        bristle = initial[2]
        if time > 0.0:
            bristle = friction_state(bristle, x - initial[0], time, law[4], law[5], law[6])
        force += law[3] * bristle
    return force


@inline_jit
def advance(
    f: Triple, initial: Triple, law: Law, h: float, over: tuple[Transition, Transition]
) -> Triple:
    """Return the state of the mode `h` [s] after `initial` with the input `f`.

    The linear part is exact, by its transition over half and the whole step. The input within the
    step and the restoring forces are integrated by a Runge-Kutta scheme of fourth order in the
    coordinates of the linear solution (Lawson).
    """
    half, full = over
    square = (2.0 * pi * law[0]) ** 2
    x, v = initial[0] - f[1], initial[1]
    a1 = square * (f[0] - f[1] - pull(initial[0], initial, 0.0, law))
    xh = half[0] * x + half[1] * v
    a2 = -square * pull(xh + 0.5 * h * half[1] * a1 + f[1], initial, 0.5 * h, law)
    a3 = -square * pull(xh + f[1], initial, 0.5 * h, law)
    xf, vf = full[0] * x + full[1] * v, full[2] * x + full[3] * v
    a4 = square * (f[2] - f[1] - pull(xf + h * half[1] * a3 + f[1], initial, h, law))
    moved = xf + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + f[1]
    speed = vf + h / 6.0 * (full[3] * a1 + 2.0 * half[3] * (a2 + a3) + a4)
    bristle = initial[2]
    if law[3] > 0.0:
        bristle = friction_state(bristle, moved - initial[0], h, law[4], law[5], law[6])
    return moved, speed, bristle


@inline_jit
def turn(before: float, after: float, law: Law, h: float) -> float:
    """Return the share of a step of `h` [s] at which the friction reverses; 0 if it does not.

    `before` and `after` are the velocities at its ends.
    """
    if law[3] == 0.0 or before * after >= 0.0:
        return 0.0
    if abs(before - after) * h < _STILL * law[4]:
        return 0.0
    share = before / (before - after)
    return 0.0 if share < _BRIEF or share > 1.0 - _BRIEF else share


@inline_jit
def within(f: Triple, begin: float, end: float) -> Triple:
    """Return the input at start, middle and end of a part of a step."""
    slope, bend = -3.0 * f[0] + 4.0 * f[1] - f[2], 2.0 * (f[0] - 2.0 * f[1] + f[2])
    middle = 0.5 * (begin + end)
    return (
        f[0] + begin * (slope + begin * bend),
        f[0] + middle * (slope + middle * bend),
        f[0] + end * (slope + end * bend),
    )


@inline_jit
def in_two(f: Triple, initial: Triple, law: Law, h: float, share: float) -> Triple:
    """Return the state of the mode after a step in two parts, the first of length `share`."""
    first, second = share * h, (1.0 - share) * h
    there = advance(within(f, 0.0, share), initial, law, first, transitions(law, first))
    return advance(within(f, share, 1.0), there, law, second, transitions(law, second))


@inline_jit
def turning(
    f: Triple, initial: Triple, law: Law, h: float, over: tuple[Transition, Transition]
) -> Triple:
    """Return the state of the mode as `advance` does, in two parts if the friction reverses.

    The bristle force has a corner there. The reversal is where the velocity, estimated from the
    whole step, is zero.
    """
    there = advance(f, initial, law, h, over)
    share = turn(initial[1], there[1], law, h)
    return there if share == 0.0 else in_two(f, initial, law, h, share)


@inline_jit
def parts_of_a_tick(p: FloatArray, dt: float) -> int:
    """Return the steps per tick for the forces, from the largest stiffness."""
    stiff = 1.0 + p[3] * p[5] / p[4]
    turned = 2.0 * pi * p[0] * dt * sqrt(stiff)
    return int(max(_FEWEST, min(ceil(min(turned / _STRIDE, 1e6)), _MOST_PARTS)))


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the position; state is (position [m], velocity [m/s], bristle)."""
    parts = parts_of_a_tick(p, dt)
    h = dt / parts
    law = law_of(p, h)
    over = transitions(law, h)
    now = (state[0], state[1], state[2])
    for k in range(x.size):
        y[k] = now[0]
        held = (x[k], x[k], x[k])
        for _ in range(parts):
            now = turning(held, now, law, h, over)
    state[0], state[1], state[2] = now


@inline_jit
def parts_of_a_step(p: FloatArray, dt: float, steps: int) -> int:
    """Return the even number of parts of one of `steps` per tick."""
    return 2 * max(1, (parts_of_a_tick(p, dt) + 2 * steps - 1) // (2 * steps))


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the position along a path, three points per step; state as in the kernel."""
    steps = points // 3
    parts = parts_of_a_step(p, dt, steps)
    h = dt / (steps * parts)
    law = law_of(p, h)
    over = transitions(law, h)
    now = (state[0], state[1], state[2])
    for k in range(0, x.size, 3):
        whole = (x[k], x[k + 1], x[k + 2])
        y[k] = now[0]
        for i in range(parts):
            now = turning(within(whole, i / parts, (i + 1) / parts), now, law, h, over)
            if 2 * (i + 1) == parts:
                y[k + 1] = now[0]
        y[k + 2] = now[0]
    state[0], state[1], state[2] = now


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
    kernel=kernel,
    state_size=3,
    between=InterSample.INNER,
    unknown=(0, 1, 2),
    path_kernel=along,
    mode=InnerMode(pace, restoring),
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
        starts=(_OWN[name], *_ALTERNATIVES[name]),
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
        starts=(
            {**_OWN['friction'], 'breakaway': 1.2, 'stribeck_speed': 1e-3},
            *_ALTERNATIVES['friction'],
        ),
    ),
    *(
        replace(effect, variant='in_nonlinear_mode', block=None, replaces=(), holds={})
        for name, effect in _IN_MODE.items()
    ),
)
