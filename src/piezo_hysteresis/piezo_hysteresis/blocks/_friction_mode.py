"""Kernels of a mode whose spring is not linear and whose guidance rubs."""

from math import ceil, exp, pi, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.jit import jit

# Longest step [rad], and how many to a tick: rubbing turns round within a step.
_STRIDE = 0.25
_FEWEST = 4
_MOST_PARTS = 400
_BRIEF = 1e-6  # share of a step that is not worth one of its own

Transition = tuple[float, float, float, float]
"""Of position and velocity over a time, (a11, a12, a21, a22), see `hold`."""


@jit
def transitions(p: FloatArray, h: float) -> tuple[Transition, Transition]:
    """Return the transitions of the linear mode over half a step of `h` [s] and over the whole."""
    omega = 2.0 * pi * p[0]
    return hold(omega, p[1], 0.5 * h), hold(omega, p[1], h)


@jit
def friction_state(
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
            bristle = friction_state(bristle, x - begun[0], time, p[4], p[5], p[6])
        force += p[3] * bristle
    return force


@jit
def advance(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    over: tuple[Transition, Transition],
    stiffest: float,
) -> None:
    """Move `state` on by `h` [s] with the input `f` at its start, middle and end.

    The linear part is exact, by its transition over half and the whole of the step; what the
    input does within the step and the forces that act back are carried by a Runge-Kutta scheme of
    fourth order in coordinates that move with the linear part (Lawson).
    """
    half, full = over
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
        state[2] = friction_state(state[2], moved - state[0], h, p[4], p[5], p[6])
    state[0] = moved


@jit
def turn(before: float, after: float, p: FloatArray) -> float:
    """Return the share of a step at which what rubs turns round; 0 where it does not.

    `before` and `after` are the velocities at its ends.
    """
    if p[3] == 0.0 or before * after >= 0.0:
        return 0.0
    share = before / (before - after)
    return 0.0 if share < _BRIEF or share > 1.0 - _BRIEF else share


@jit
def within(f: tuple[float, float, float], begin: float, end: float) -> tuple[float, float, float]:
    """Return the input at start, middle and end of a part of a step."""
    slope, bend = -3.0 * f[0] + 4.0 * f[1] - f[2], 2.0 * (f[0] - 2.0 * f[1] + f[2])
    middle = 0.5 * (begin + end)
    return (
        f[0] + begin * (slope + begin * bend),
        f[0] + middle * (slope + middle * bend),
        f[0] + end * (slope + end * bend),
    )


@jit
def in_two(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    share: float,
    stiffest: float,
) -> None:
    """Move `state` on by `h` [s] in two parts, the first as long as `share` says."""
    for begin, end in ((0.0, share), (share, 1.0)):
        part = (end - begin) * h
        advance(within(f, begin, end), state, p, part, transitions(p, part), stiffest)


@jit
def turning(
    f: tuple[float, float, float],
    state: FloatArray,
    p: FloatArray,
    h: float,
    over: tuple[Transition, Transition],
    stiffest: float,
) -> None:
    """Move `state` on as `advance` does; where it rubs and turns round, in two parts.

    The force of the bristles has a corner there. The turn is where the velocity, as far as the
    whole step tells, runs through zero.
    """
    x, v, bristle = state[0], state[1], state[2]
    advance(f, state, p, h, over, stiffest)
    share = turn(v, state[1], p)
    if share == 0.0:
        return
    state[0], state[1], state[2] = x, v, bristle
    in_two(f, state, p, h, share, stiffest)


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
    """Return the position; state is (position [m], velocity [m/s], bristle)."""
    parts = parts_of_a_tick(p, dt)
    h = dt / parts
    over = transitions(p, h)
    stiffest = 1.0 / (2.0 * pi * p[0] * h) ** 2
    for k in range(x.size):
        y[k] = state[0]
        held = (x[k], x[k], x[k])
        for _ in range(parts):
            turning(held, state, p, h, over, stiffest)


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the position along a path, three points to a step; state as in the kernel."""
    steps = points // 3
    middle = max(1, (parts_of_a_tick(p, dt) + 2 * steps - 1) // (2 * steps))
    parts = 2 * middle
    h = dt / (steps * parts)
    over = transitions(p, h)
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
            turning(f, state, p, h, over, stiffest)
            if i + 1 == middle:
                y[k + 1] = state[0]
        y[k + 2] = state[0]
