"""Exponential and norm of small matrices of rates, in compiled loops.

LAPACK starts threads even for the 2 x 2 matrix of a mode and takes milliseconds on a busy machine;
a fit needs thousands of these.
"""

from __future__ import annotations

from math import ceil, log2

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit, leaf

_TERMS = 18  # terms of the series, for a norm up to 1: the remainder is below rounding
_SWEEPS = 60  # passes of balancing; each halves or doubles


@leaf
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


@leaf
def norm(matrix: FloatArray) -> float:
    """Return the largest sum of magnitudes of a row."""
    largest = 0.0
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    return largest


@leaf
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


@leaf
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
