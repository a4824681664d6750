"""Exact discretisation of linear blocks in series as one continuous system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import System
from piezo_hysteresis.jit import inline_jit, jit, scratch
from piezo_hysteresis.numerics.linalg import exponential, pace, solve_square

# From start, middle and end of a step to value, slope and curvature at its start, per step.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [4.0, -8.0, 4.0]])

_AT_ONCE = 1e8  # ratio of step to time constant from which a lag is treated as instantaneous


class LinearStep(NamedTuple):
    """One step of a linear system with n states for an input of m points.

    Three points, at start, middle and end, define a parabola; one is held.
    """

    phi: FloatArray  # (n, n)
    gamma: FloatArray  # (n, m)
    rows: FloatArray  # (m, n)
    gains: FloatArray  # (m, m)


def in_series(systems: Sequence[System]) -> System:
    """Return the series connection of `systems` as one system."""
    whole = System(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    for each in systems:
        a = np.block(
            [[whole.a, np.zeros((whole.b.size, each.b.size))], [np.outer(each.b, whole.c), each.a]]
        )
        b = np.concatenate([whole.b, whole.d * each.b])
        c = np.concatenate([each.d * whole.c, each.c])
        whole = System(a, b, c, each.d * whole.d)
    return whole


def fastest(systems: Sequence[System]) -> float:
    """Return the approximate rate of the fastest pole of `systems` [1/s]."""
    sizes = [float(pace(each.a)) if np.all(np.isfinite(each.a)) else np.inf for each in systems]
    return max(sizes, default=0.0)


def settled(system: System, dt: float) -> System:
    """Return the system with very short lags replaced by their static gain.

    They would cause large rounding errors. Their states remain constant.
    """
    quick = np.abs(np.diagonal(system.a)) * dt > _AT_ONCE
    if not np.any(quick):
        return system
    slow = ~quick
    own = system.a[np.ix_(quick, quick)]
    way = np.zeros((own.shape[0], int(np.sum(slow))))
    for j, column in enumerate(system.a[np.ix_(quick, slow)].T):
        way[:, j] = solve_square(own, column).values
    come = solve_square(own, system.b[quick]).values
    a, b, c = np.zeros_like(system.a), np.zeros_like(system.b), np.zeros_like(system.c)
    across = system.a[np.ix_(slow, quick)]
    a[np.ix_(slow, slow)] = system.a[np.ix_(slow, slow)] - across @ way
    b[slow] = system.b[slow] - across @ come
    c[slow] = system.c[slow] - system.c[quick] @ way
    return System(a, b, c, system.d - float(system.c[quick] @ come))


def step_of(system: System, h: float) -> LinearStep:
    """Return the exact step over `h` [s] for an input that is a parabola.

    The start value of the output is such that Simpson's rule gives the exact mean of the output
    over the step. For slow systems it is the start value itself; for a lag that settles within the
    step it is the input.
    """
    system = settled(system, h)
    n = system.b.size
    # states, their integral, then value, slope and curvature of the input over one step
    wide = np.zeros((n + 4, n + 4))
    wide[:n, :n] = h * system.a
    wide[:n, n + 1] = h * system.b
    wide[n, :n] = system.c
    wide[n, n + 1] = system.d
    wide[n + 1, n + 2] = wide[n + 2, n + 3] = 1.0
    full, half = _exponential(wide), _exponential(0.5 * wide)
    known = np.zeros((n + 3, n + 3))
    known[:n, :n] = np.eye(n)
    known[n:, n:] = _PARABOLA
    keep = [*range(n), n + 1, n + 2, n + 3]
    gamma = full[:n][:, keep] @ known
    output = np.concatenate([system.c, [0.0]])
    direct = np.zeros((2, n + 3))
    direct[0, n + 1] = direct[1, n + 2] = system.d
    middle = output @ half[: n + 1][:, keep] @ known + direct[0]
    end = output @ full[: n + 1][:, keep] @ known + direct[1]
    mean = full[n][keep] @ known
    outputs = np.array([6.0 * mean - 4.0 * middle - end, middle, end])
    return LinearStep(
        np.ascontiguousarray(gamma[:, :n].T),
        np.ascontiguousarray(gamma[:, n:]),
        np.ascontiguousarray(outputs[:, :n]),
        np.ascontiguousarray(outputs[:, n:]),
    )


def hold_of(system: System, dt: float, part: float) -> LinearStep:
    """Return the exact hold over `dt` [s], sampled after `part` of it."""
    system = settled(system, dt)
    n = system.b.size
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n] = dt * system.a
    wide[:n, n] = dt * system.b
    full = _exponential(wide)
    there = _exponential(part * wide)[:n]
    return LinearStep(
        np.ascontiguousarray(full[:n, :n].T),
        np.ascontiguousarray(full[:n, n:]),
        (system.c @ there[:, :n])[None],
        np.array([[float(system.c @ there[:, n] + system.d)]]),
    )


def _exponential(matrix: FloatArray) -> FloatArray:
    if not np.all(np.isfinite(matrix)):
        return np.full_like(matrix, np.nan)
    with np.errstate(over='ignore', invalid='ignore'):
        return exponential(matrix)


@inline_jit
def nonzero(phi: FloatArray, places: FloatArray, shares: FloatArray, counts: FloatArray) -> None:
    """Fill indices and values of the nonzero entries of each row i of `phi`, counts[i] of them.

    Parallel elements are not coupled, so that most of `phi` is zero if there are many.
    """
    n = phi.shape[0]
    for i in range(n):
        count = 0
        for j in range(n):
            if phi[j, i] != 0.0:
                places[i, count], shares[i, count] = j, phi[j, i]
                count += 1
        counts[i] = count


def _recursion(points: int) -> Any:
    """Return the kernel of a linear system with one input, `points` per step."""
    end = points - 1

    @jit
    def run(
        x: FloatArray,
        y: FloatArray,
        state: FloatArray,
        phi: FloatArray,
        gamma: FloatArray,
        rows: FloatArray,
        gains: FloatArray,
    ) -> None:
        """Return the output; `state` in place."""
        n, side, gain = state.size, 0, gains[end, 0]
        places, shares = scratch((n, n)), scratch((n, n))
        counts, states = scratch(n), scratch((2, n))
        nonzero(phi, places, shares, counts)
        for i in range(n):
            states[0, i] = state[i]
        for k in range(0, x.size, points):
            now, new = states[side], states[1 - side]
            side = 1 - side
            first, middle, last = x[k], x[k + points // 2], x[k + end]
            for r in range(end):
                total = gains[r, 0] * first + gains[r, 1] * middle + gains[r, 2] * last
                for i in range(n):
                    total += rows[r, i] * now[i]
                y[k + r] = total
            total = gain * first
            if end > 0:
                total = total + gains[end, 1] * middle + gains[end, 2] * last
            for i in range(n):
                total += rows[end, i] * now[i]
                moved = gamma[i, 0] * first
                if end > 0:
                    moved = moved + gamma[i, 1] * middle + gamma[i, 2] * last
                for r in range(int(counts[i])):
                    moved += shares[i, r] * now[int(places[i, r])]
                new[i] = moved
            y[k + end] = total
        for i in range(n):
            state[i] = states[side, i]

    return run


def _interleaved(points: int) -> Any:
    """Return the kernel for several inputs, `x` and `y` of shape (m, n), states of shape (m, s).

    Four recursions are interleaved, because a single one mostly waits for its own last value. The
    results are bitwise those of `_recursion`.
    """
    end = points - 1

    @jit
    def run(
        x: FloatArray,
        y: FloatArray,
        state: FloatArray,
        phi: FloatArray,
        gamma: FloatArray,
        rows: FloatArray,
        gains: FloatArray,
    ) -> None:
        """Return the outputs; `state` in place."""
        n, last, u = phi.shape[0], x.shape[0] - 1, scratch((points, 4))
        places, shares, counts = scratch((n, n)), scratch((n, n)), scratch(n)
        states, total, moved = np.empty((2, n, 4)), scratch(4), scratch(4)
        nonzero(phi, places, shares, counts)
        for begin in range(0, last + 1, 4):
            for lane in range(4):
                states[0, :, lane] = state[min(begin + lane, last)]
            side = 0
            for k in range(0, x.shape[1], points):
                now, new = states[side], states[1 - side]
                side = 1 - side
                for lane in range(4):
                    for r in range(points):
                        u[r, lane] = x[min(begin + lane, last), k + r]
                for r in range(points):
                    for lane in range(4):
                        total[lane] = gains[r, 0] * u[0, lane]
                    for s in range(1, points):
                        for lane in range(4):
                            total[lane] += gains[r, s] * u[s, lane]
                    if r == end:  # with the states
                        break
                    for i in range(n):
                        for lane in range(4):
                            total[lane] += rows[r, i] * now[i, lane]
                    for lane in range(4):
                        y[min(begin + lane, last), k + r] = total[lane]
                for i in range(n):
                    for lane in range(4):
                        total[lane] += rows[end, i] * now[i, lane]
                        moved[lane] = gamma[i, 0] * u[0, lane]
                    for s in range(1, points):
                        for lane in range(4):
                            moved[lane] += gamma[i, s] * u[s, lane]
                    for r in range(int(counts[i])):
                        share, j = shares[i, r], int(places[i, r])
                        for lane in range(4):
                            moved[lane] += share * now[j, lane]
                    for lane in range(4):
                        new[i, lane] = moved[lane]
                for lane in range(4):
                    y[min(begin + lane, last), k + end] = total[lane]
            for lane in range(4):
                state[min(begin + lane, last)] = states[side, :, lane]

    return run


# A held input has one point per step, a path three: at the start, in the middle and at the end.
run_held, run_path = _recursion(1), _recursion(3)
run_held_four, run_path_four = _interleaved(1), _interleaved(3)


@jit
def run_free(rows: FloatArray, phi: FloatArray, row: FloatArray) -> None:
    """Return the free response from a unit value of each state: rows, shape (q, n)."""
    q = row.size
    seen, new = row.copy(), scratch(q)
    places, shares, counts = scratch((q, q)), scratch((q, q)), scratch(q)
    nonzero(phi, places, shares, counts)
    for k in range(rows.shape[1]):
        for j in range(q):
            rows[j, k] = seen[j]
            new[j] = 0.0
        for i in range(q):
            for r in range(int(counts[i])):
                new[int(places[i, r])] += shares[i, r] * seen[i]
        for j in range(q):
            seen[j] = new[j]
