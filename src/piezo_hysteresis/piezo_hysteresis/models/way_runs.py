"""What moves one way within a tick, a memory that follows it, and linear blocks behind that.

The input of such a run goes to its held value by a lag or along a ramp, and stays. A memory is
asked at the Gauss points of that way, and the linear blocks take up the integral: the impulse
response over a tick, a polynomial, at the same points. That is exact to 1e-7 of what moves within
the tick, wherever the way ends, and much less work than a path of many steps.
"""

from __future__ import annotations

from math import exp, factorial, inf
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import System, Way
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models.linear_runs import decayed, fastest, settled

#: Fastest pole times the tick up to which an impulse response is a polynomial of moderate degree.
SLOW = 4.0
_LEFT = 1e-10  # of an impulse response that its polynomial may leave
_OVER = 10.0  # time constants after which a lag has come to its end
# Gauss points for a lag that lasts up to so many time constants; a ramp needs the fewest.
_POINTS = ((2.0, 4), (5.0, 6), (_OVER, 8))


class Response(NamedTuple):
    """A linear system over one tick, with the impulse response as a polynomial.

    Attributes
    ----------
    phi : ndarray, shape (n, n)
        Transition over the tick, transposed.
    impulse, integral : ndarray, shapes (m + 1, n) and (m + 2, n)
        State at the end of the tick for an impulse at ``t``, -1 at its start and 1 at its end,
        and the integral of that over the time in ticks: coefficients of powers of t.
    row, direct : ndarray, shape (n,), and float
        Output.
    """

    phi: FloatArray
    impulse: FloatArray
    integral: FloatArray
    row: FloatArray
    direct: float


def response_of(system: System, dt: float) -> Response:
    """Return `system` over ticks of `dt` [s]; its poles must be slower than `SLOW` per tick."""
    system = settled(system, dt)
    pace = 0.5 * dt * fastest(system)
    degree = 3
    while pace ** (degree + 1) > _LEFT * 2.0**degree * factorial(degree + 1):
        degree += 1
    places = np.polynomial.chebyshev.chebpts1(degree + 1)
    values = [decayed(system.a, 0.5 * (1.0 - t) * dt) @ system.b * dt for t in places]
    series = np.polynomial.chebyshev.chebfit(places, np.array(values), degree)
    impulse = np.zeros((degree + 1, system.b.size))
    integral = np.zeros((degree + 2, system.b.size))
    for i in range(system.b.size):
        own = np.polynomial.chebyshev.cheb2poly(series[:, i])
        impulse[: own.size, i] = own
        whole = 0.5 * np.polynomial.polynomial.polyint(impulse[:, i])
        integral[:, i] = whole
    phi = np.ascontiguousarray(decayed(system.a, dt).T)
    return Response(phi, impulse, integral, system.c, system.d)


def gauss_of(way: Way, dt: float) -> tuple[FloatArray, FloatArray]:
    """Return Gauss points and weights on 0..1 for the time that a way takes within a tick."""
    lasts = min(_OVER, dt / way.time) if way.time > 0.0 else 0.0
    count = next(points for most, points in _POINTS if lasts <= most)
    places, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (1.0 + places), 0.5 * weights


@jit
def go(
    begun: float, target: float, length: float, way: tuple[float, float], dt: float,
    places: FloatArray, values: FloatArray,
) -> float:  # fmt: skip
    """Fill `values` with the way from `begun` to `target` within `length` ticks.

    At `places` of the time that it moves, and last at its end. Returns that time [ticks]. `way` is
    (time constant [s], largest rate [1/s]), one of which rules.
    """
    count = places.size
    gap = target - begun
    if way[0] > 0.0:
        lasts = min(length, _OVER * way[0] / dt)
        for i in range(count):
            values[i] = target - gap * exp(-lasts * places[i] * dt / way[0])
        values[count] = target - gap * exp(-length * dt / way[0])
        return lasts
    most = way[1] * dt
    if abs(gap) <= most * length:
        lasts = abs(gap) / most if most < inf and most > 0.0 else 0.0
        values[count] = target
    else:
        lasts = length
        values[count] = begun + (most if gap > 0.0 else -most) * length
    for i in range(count):
        values[i] = begun + (values[count] - begun) * places[i]
    return lasts


@jit
def ways(
    old: FloatArray, new: FloatArray, part: float, state: FloatArray, way: tuple[float, float],
    dt: float, places: FloatArray, values: FloatArray, lasts: FloatArray,
) -> None:  # fmt: skip
    """Fill `values`, shape (n, pieces, points + 1), and `lasts`, shape (n, pieces).

    Of two pieces the first, `part` of the tick long, still goes to the `old` input.
    """
    pieces = lasts.shape[1]
    for k in range(new.size):
        for i in range(pieces):
            first = pieces == 2 and i == 0
            length = part if first else (1.0 - part if pieces == 2 else 1.0)
            target = old[k] if first else new[k]
            lasts[k, i] = go(state[0], target, length, way, dt, places, values[k, i])
            state[0] = values[k, i, places.size]


@jit
def add_at(t: float, powers: FloatArray, factor: float, total: FloatArray) -> None:
    """Add `factor` times the polynomials with coefficients `powers` at `t`."""
    for i in range(total.size):
        value = powers[powers.shape[0] - 1, i]
        for j in range(powers.shape[0] - 2, -1, -1):
            value = value * t + powers[j, i]
        total[i] += factor * value


@jit
def take_up(
    values: FloatArray, lasts: FloatArray, part: float, places: FloatArray, weights: FloatArray,
    y: FloatArray, state: FloatArray, last: FloatArray, phi: FloatArray, impulse: FloatArray,
    integral: FloatArray, row: FloatArray, direct: float, ahead: bool,
) -> None:  # fmt: skip
    """Answer with linear blocks what goes as `values` within the ticks; `state` in place.

    ``last[0]`` is the input at the end of the last tick. Read at the end of the tick where it is
    `ahead`, else at its start.
    """
    n, pieces, count = state.size, lasts.shape[1], places.size
    new = np.empty(n)
    for k in range(y.size):
        if not ahead:
            y[k] = direct * last[0]
            for i in range(n):
                y[k] += row[i] * state[i]
        new[:] = 0.0
        for j in range(n):
            for i in range(n):
                new[i] += phi[j, i] * state[j]
        for piece in range(pieces):
            begin = part if pieces == 2 and piece == 1 else 0.0
            end = part if pieces == 2 and piece == 0 else 1.0
            moves = lasts[k, piece]
            for i in range(count if moves > 0.0 else 0):
                t = 2.0 * (begin + moves * places[i]) - 1.0
                add_at(t, impulse, moves * weights[i] * values[k, piece, i], new)
            last[0] = values[k, piece, count]
            if begin + moves < end:
                add_at(2.0 * end - 1.0, integral, last[0], new)
                add_at(2.0 * (begin + moves) - 1.0, integral, -last[0], new)
        for i in range(n):
            state[i] = new[i]
        if ahead:
            y[k] = direct * last[0]
            for i in range(n):
                y[k] += row[i] * state[i]
