"""Compiled products and triangular factor of a tall problem, without BLAS.

A matrix library may spread one small product over threads, which costs more than it saves (on a
busy machine a hundred times) and competes with the threads over the records; these kernels release
the interpreter lock instead.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit


@jit
def inner(a: FloatArray, b: FloatArray) -> float:
    """Return the inner product of two vectors, in four sums that run side by side."""
    n = a.size
    s0 = s1 = s2 = s3 = 0.0
    whole = n - n % 4
    for k in range(0, whole, 4):
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
    for k in range(whole, n):
        s0 += a[k] * b[k]
    return (s0 + s1) + (s2 + s3)


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


@jit
def triangle(rows: FloatArray) -> FloatArray:
    """Return R of the QR factorisation of ``rows.T`` by Householder reflections.

    Parameters
    ----------
    rows : ndarray, shape (p, m)
        The columns of the matrix, one per row; destroyed.

    Returns
    -------
    ndarray, shape (p, p)
        Upper triangle with ``R'R = rows @ rows.T``; rows of zeros where m < p.
    """
    p, m = rows.shape
    r = np.zeros((p, p))
    for j in range(min(p, m)):
        v = rows[j, j:]
        size = sqrt(inner(v, v))
        if size == 0.0:
            for i in range(j + 1, p):
                r[j, i] = rows[i, j]
            continue
        alpha = -size if v[0] > 0.0 else size
        r[j, j] = alpha
        v[0] -= alpha
        square = inner(v, v)
        for i in range(j + 1, p):
            w = rows[i, j:]
            share = 2.0 * inner(v, w) / square
            for k in range(v.size):
                w[k] -= share * v[k]
            r[j, i] = w[0]
    return r
