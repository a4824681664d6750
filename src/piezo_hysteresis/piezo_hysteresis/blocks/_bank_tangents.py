"""Derivatives of banks of plays by their weights: the answers of the plays themselves.

A tangent kernel ``(x, y, dx, dy, p, dt)`` answers the input x, shape (n,), from rest, as the block
does, and carries derivatives along: `dx`, shape (m, n), holds those of the input with respect to m
parameters upstream; it fills `dy`, shape (m + q, n), with those of the output, the block's own q
parameters last. The generated derivative knows not that a bank is linear in its weights, and takes
30 times as long for twenty of them.
"""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit


@jit
def _line(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, factor: float, shift: float
) -> None:
    """Fill y and the rows of dy that come in with a straight line and its slope.

    In loops: an assignment of arrays takes seconds to compile, for the text of its errors.
    """
    for k in range(x.size):
        y[k] = factor * x[k] + shift
    for j in range(dx.shape[0]):
        for k in range(x.size):
            dy[j, k] = factor * dx[j, k]


@jit
def _bank_rows(
    x: FloatArray,
    y: FloatArray,
    dx: FloatArray,
    dy: FloatArray,
    weights: FloatArray,
    spacing: float,
    lowest: float,
    first: int,
) -> None:
    """Add a bank of plays to y and dy; row first + j is the answer of play j + 1.

    The thresholds are lowest spacing, (lowest + 1) spacing, ...
    """
    m = dx.shape[0]
    tied = np.zeros(m)
    for j in range(weights.size):
        half = (j + lowest) * spacing
        row = dy[first + j]
        memory = 0.0
        tied[:] = 0.0
        for k in range(x.size):
            low, high = x[k] - half, x[k] + half
            # a play that is pushed follows the derivative of its input, one at rest keeps its own
            if memory < low or memory > high:
                memory = low if memory < low else high
                for i in range(m):
                    tied[i] = dx[i, k]
            row[k] = memory
            y[k] += weights[j] * memory
            for i in range(m):
                dy[i, k] += weights[j] * tied[i]


@jit
def prandtl_ishlinskii(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    _straight(x, y, dx, dy, p)
    _bank_rows(x, y, dx, dy, p[2:], p[0] / (p.size - 1), 1.0, dx.shape[0] + 2)


@jit
def prandtl_ishlinskii_fine(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    _straight(x, y, dx, dy, p)
    _bank_rows(x, y, dx, dy, p[2:], p[0] / (p.size - 2), 0.5, dx.shape[0] + 2)


@jit
def _straight(x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray) -> None:
    """Begin with the weight without threshold, whose row comes behind that of the range."""
    m = dx.shape[0]
    _line(x, y, dx, dy, p[1], 0.0)
    dy[m] = 0.0
    for k in range(x.size):
        dy[m + 1, k] = x[k]


@jit
def nonlocal_memory(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, p: FloatArray, dt: float
) -> None:
    """Return for each play its weight's derivative; the range must be held."""
    m = dx.shape[0]
    y[:] = 0.0
    dy[: m + 1] = 0.0
    _bank_rows(x, y, dx, dy, p[1:], p[0] / p.size, 1.0, m + 1)
