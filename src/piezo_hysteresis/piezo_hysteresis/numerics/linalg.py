"""Linear algebra that returns finite values and a success flag instead of an exception.

The factorisations of LAPACK raise an error if an entry is not finite, and sometimes if it is very
large. The suite calls them only through this module, so that failures are handled uniformly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.jit import inline_jit, jit
from piezo_hysteresis.numerics.qr import triangle

# Equations per unknown from which the factor R replaces the matrix before its singular values.
_TALL = 16


@dataclass(frozen=True)
class Solved:
    """The solution of a linear problem."""

    values: FloatArray  # the unknowns; zeros where there is no solution, shape (p,)
    sound: bool  # whether they solve the problem


def solve_least_squares(
    matrix: FloatArray, target: FloatArray, rcond: float | None = None
) -> Solved:  # matrix (n, p); target (n,)
    """Minimise ``|matrix x - target|``; of several such x take the smallest."""
    count, unknowns = np.shape(matrix)
    if count > _TALL * unknowns:
        rcond = np.finfo(float).eps * count if rcond is None else rcond
        return solve_factored(triangle(np.vstack([np.transpose(matrix), target])), rcond)
    return _least_squares(matrix, target, rcond)


def solve_factored(factor: FloatArray, rcond: float | None = None) -> Solved:
    """Do the same for the triangle of matrix and target, shape (p + 1, p + 1)."""
    return _least_squares(factor[:-1, :-1], factor[:-1, -1], rcond)


def _least_squares(matrix: FloatArray, target: FloatArray, rcond: float | None) -> Solved:
    given = matrix, target
    found = _attempt(lambda: (np.linalg.lstsq(matrix, target, rcond=rcond)[0],), given)
    if found is None:
        found = _attempt(lambda: (_scaled_least_squares(matrix, target, rcond),), given)
    if found is None:
        return Solved(np.zeros(np.shape(matrix)[1]), False)
    return Solved(found[0], True)


def _scaled_least_squares(
    matrix: FloatArray, target: FloatArray, rcond: float | None
) -> FloatArray:
    """Solve with normalised columns by pivoted QR, which always terminates."""
    from scipy.linalg import lstsq

    sizes = np.abs(matrix).max(axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    size = float(np.abs(target).max()) or 1.0
    found = lstsq(matrix / sizes, target / size, cond=rcond, lapack_driver='gelsy')[0]
    return np.asarray(found / sizes * size, dtype=np.float64)


def solve_square(matrix: FloatArray, right: FloatArray) -> Solved:  # matrix (p, p); right (p,)
    """Solve ``matrix x = right``; a singular matrix gets the smallest least-squares solution."""
    found = _attempt(lambda: (np.linalg.solve(matrix, right),), (matrix, right))
    return Solved(found[0], True) if found is not None else solve_least_squares(matrix, right)


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray] | None:  # matrix (p, p)
    """Return eigenvalues, ascending, and vectors as columns; None after a failure."""
    found = _attempt(lambda: tuple(np.linalg.eigh(matrix)), (matrix,))
    return None if found is None else (found[0], found[1])


def right_singular(matrix: FloatArray) -> tuple[FloatArray, FloatArray] | None:  # matrix (n, p)
    """Return singular values, descending, and the right vectors as rows; None after a failure."""
    found = _attempt(lambda: np.linalg.svd(matrix, full_matrices=False)[1:], (matrix,))
    return None if found is None else (found[0], found[1])


def column_norms(matrix: FloatArray) -> FloatArray:  # matrix (n, p) -> (p,)
    """Return the Euclidean norm of every column, also if its square overflows."""
    with np.errstate(over='ignore', invalid='ignore'):
        norms = np.linalg.norm(matrix, axis=0)
        huge = ~np.isfinite(norms)
        if np.any(huge):
            size = np.abs(matrix[:, huge]).max(axis=0)
            norms[huge] = size * np.linalg.norm(matrix[:, huge] / size, axis=0)
    return np.asarray(norms)


def straight_line(values: FloatArray) -> tuple[float, float]:  # values (n,)
    """Return level at the first sample and slope per sample of the least-squares line."""
    place = np.arange(values.size) - 0.5 * (values.size - 1)
    slope = float(place @ values) / float(place @ place)
    return float(np.mean(values)) - 0.5 * (values.size - 1) * slope, slope


@contextmanager
def failing_as(error: PiezoError) -> Iterator[None]:
    """Convert numerical errors of a code block to `error`, with a message on its subject."""
    try:
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            yield
    except (np.linalg.LinAlgError, ValueError) as failure:
        raise error from failure


def _attempt(
    compute: Callable[[], tuple[Any, ...]], given: tuple[FloatArray, ...]
) -> tuple[FloatArray, ...] | None:
    """Return the result of `compute` for `given`, None after a failure or if not finite."""
    if not _finite(given):
        return None
    try:
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            found = compute()
    except (np.linalg.LinAlgError, ValueError):
        return None
    return found if _finite(found) else None


def _finite(arrays: tuple[FloatArray, ...]) -> bool:
    return all(np.all(np.isfinite(each)) for each in arrays)


_TERMS = 18  # terms of the series, for a norm up to 1: the remainder is below rounding
_SWEEPS = 60  # passes of balancing; each halves or doubles


@inline_jit
def balance(matrix: FloatArray) -> FloatArray:
    """Scale rows and columns of `matrix`, in place, to equal norms; return the scales.

    The scales are powers of two, so that there is no rounding (Osborne; Parlett and Reinsch). The
    matrix of a mode contains rates and squares of rates.
    """
    n = matrix.shape[0]
    scale = np.ones(n)
    for _ in range(_SWEEPS):
        changed = False
        for i in range(n):
            column = row = 0.0
            for j in range(n):
                if j != i:
                    column += abs(matrix[j, i])
                    row += abs(matrix[i, j])
            if column == 0.0 or row == 0.0:
                continue
            f = 2.0 ** round(0.5 * log2(row / column))
            if f != 1.0 and (column * f + row / f) < 0.95 * (column + row):
                changed = True
                scale[i] *= f
                for j in range(n):
                    matrix[i, j] /= f
                    matrix[j, i] *= f
        if not changed:
            break
    return scale


@inline_jit
def norm(matrix: FloatArray) -> float:
    """Return the largest sum of magnitudes of a row."""
    largest = 0.0
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    return largest


@inline_jit
def product(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    """Fill `c` with the product of the square matrices `a` and `b`."""
    n = a.shape[0]
    c[:] = 0.0
    for i in range(n):
        for k in range(n):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(n):
                    c[i, j] += factor * b[k, j]


@inline_jit
def of_balanced(matrix: FloatArray) -> FloatArray:
    """Return the exponential by scaling and squaring of its series."""
    n = matrix.shape[0]
    size = norm(matrix)
    squarings = max(0, ceil(log2(size))) if size > 0.0 else 0
    small = matrix / 2.0**squarings
    total, term, new = np.eye(n), np.eye(n), np.empty((n, n))
    for k in range(1, _TERMS + 1):
        product(term, small, new)
        for i in range(n):
            for j in range(n):
                term[i, j] = new[i, j] / k
                total[i, j] += term[i, j]
    for _ in range(squarings):
        product(total, total, new)
        for i in range(n):  # an assignment of arrays takes seconds to compile
            for j in range(n):
                total[i, j] = new[i, j]
    return total


@jit
def exponential(matrix: FloatArray) -> FloatArray:
    """Return the matrix exponential of finite entries, shape (n, n)."""
    balanced = matrix.copy()
    scale = balance(balanced)
    result = of_balanced(balanced)
    for i in range(scale.size):
        for j in range(scale.size):
            result[i, j] *= scale[i] / scale[j]
    return result


@jit
def pace(matrix: FloatArray) -> float:
    """Return a bound of the magnitudes of the eigenvalues, within some factor of the largest."""
    balanced = matrix.copy()
    balance(balanced)
    return norm(balanced)
