"""Compiled inner products and QR factor of a tall matrix, without BLAS.

A BLAS library may distribute one small product over threads. This costs more than it saves (on a
busy machine a hundred times) and competes with the threads over the records. These kernels release
the interpreter lock instead.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import inline_jit, jit, jit_sums


@jit_sums
def inner(a: FloatArray, b: FloatArray) -> float:
    """Return the inner product of two vectors."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@jit_sums
def _inner_four(
    v: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> tuple[float, float, float, float]:
    """Return the inner products of `v` with four vectors, reading it once."""
    s0 = s1 = s2 = s3 = 0.0
    for k in range(v.size):
        x = v[k]
        s0 += x * a[k]
        s1 += x * b[k]
        s2 += x * c[k]
        s3 += x * d[k]
    return s0, s1, s2, s3


@jit
def products(rows: FloatArray, x: FloatArray) -> FloatArray:
    """Return the inner product of each row with a vector, shape (q,)."""
    found = np.empty(rows.shape[0])
    for i in range(rows.shape[0]):
        found[i] = inner(rows[i], x)
    return found


@jit
def gram(rows: FloatArray) -> FloatArray:
    """Return the inner products of all rows with each other, shape (q, q)."""
    q = rows.shape[0]
    found = np.empty((q, q))
    for i in range(q):
        for j in range(i + 1):
            found[i, j] = found[j, i] = inner(rows[i], rows[j])
    return found


# Number of samples per piece of the factorisation, so that a piece fits into the cache.
_PIECE = 512
# Sum of squares below which its reciprocal may overflow.
_VANISHED = 1e-290
#: Samples of a block of a long record: whole pieces, so that blocks do not change a factor.
BLOCK = 64 * _PIECE


@jit
def triangle(rows: FloatArray) -> FloatArray:  # rows (p, m) -> (p, p)
    """Return R of the QR factorisation of ``rows.T`` by Householder reflections, in pieces."""
    r = np.zeros((rows.shape[0], rows.shape[0]))
    extend(r, rows)
    return r


@jit
def extend(r: FloatArray, rows: FloatArray) -> None:
    """Extend the triangle `r` of earlier samples, shape (p, p), by those of `rows`, see there.

    Blocks of whole pieces give the same bits as all samples at once.
    """
    p, m = rows.shape
    for begin in range(0, m, _PIECE):
        for j in range(p):
            _reflect(r, rows, j, begin, min(begin + _PIECE, m))


@inline_jit
def _reflect(r: FloatArray, rows: FloatArray, j: int, begin: int, end: int) -> None:
    """Reflect row `j` of a block into `r`, shape (p, p), and update the later rows."""
    p, v = rows.shape[0], rows[j, begin:end]
    own = inner(v, v)
    if own <= _VANISHED:  # a dependent column shrinks from piece to piece
        return
    size = sqrt(r[j, j] * r[j, j] + own)
    alpha = -size if r[j, j] > 0.0 else size
    head = r[j, j] - alpha
    factor = 2.0 / (head * head + own)
    r[j, j] = alpha
    i = j + 1
    while i + 3 < p:
        a, b = rows[i, begin:end], rows[i + 1, begin:end]
        c, d = rows[i + 2, begin:end], rows[i + 3, begin:end]
        s0, s1, s2, s3 = _inner_four(v, a, b, c, d)
        s0 = factor * (head * r[j, i] + s0)
        s1 = factor * (head * r[j, i + 1] + s1)
        s2 = factor * (head * r[j, i + 2] + s2)
        s3 = factor * (head * r[j, i + 3] + s3)
        r[j, i] -= s0 * head
        r[j, i + 1] -= s1 * head
        r[j, i + 2] -= s2 * head
        r[j, i + 3] -= s3 * head
        for k in range(v.size):
            x = v[k]
            a[k] -= s0 * x
            b[k] -= s1 * x
            c[k] -= s2 * x
            d[k] -= s3 * x
        i += 4
    for last in range(i, p):
        w = rows[last, begin:end]
        share = factor * (head * r[j, last] + inner(v, w))
        r[j, last] -= share * head
        for k in range(v.size):
            w[k] -= share * v[k]


@jit
def orthonormal(rows: FloatArray, tolerance: float) -> FloatArray:
    """Return orthonormal rows, shape (q, n), without BLAS threads; zeros for dependent ones.

    A row is dependent if the share `tolerance` or less of it is orthogonal to the rows before it.
    """
    found = rows.copy()
    orthonormalise(found, tolerance)
    return found


@jit
def orthonormalise(rows: FloatArray, tolerance: float) -> None:
    """Do the same in place."""
    for j in range(rows.shape[0]):
        row = rows[j]
        before = sqrt(inner(row, row))
        for _ in range(2):
            for i in range(j):
                share, other = inner(rows[i], row), rows[i]
                for k in range(row.size):
                    row[k] -= share * other[k]
        size = sqrt(inner(row, row))
        factor = 1.0 / size if size > tolerance * before else 0.0
        for k in range(row.size):
            row[k] *= factor


@jit
def projected_out(vector: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of a vector on orthonormal rows, shape (q,), and its remainder."""
    left, shares = vector.copy(), np.empty(rows.shape[0])
    for j in range(rows.shape[0]):
        shares[j] = inner(rows[j], left)
        left -= shares[j] * rows[j]
    return shares, left
