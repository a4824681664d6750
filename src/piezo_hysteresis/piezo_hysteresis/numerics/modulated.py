"""Harmonics whose amplitudes follow laws of time, fitted by normal equations in blocks of samples.

A record of millions of samples has tens of such lines. Their inner products follow from the sums
of ``law law exp(j m phase)``, so that no line is stored: the memory is that of a few laws.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray, IntArray
from piezo_hysteresis.jit import jit, leaf
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.numerics.qr import inner, orthonormalise

# Samples of a block, whose turns and products of laws fit into the cache.
_PIECE = 512


class ModulatedLines:
    """Orthonormal lines ``law cos(order phase)`` and ``law sin(order phase)`` with their mean."""

    def __init__(
        self, laws: FloatArray, phase: FloatArray, highest: int, dependent: float
    ) -> None:  # laws (a, n); phase [rad] (n,)
        orthonormalise(laws, dependent)
        self._laws, self._phase, self._highest = laws, phase, highest
        count = len(laws)
        order = [0] * count + [n for n in range(1, highest + 1) for _ in range(2 * count)]
        self.orders: IntArray = np.array(order[1:], dtype=np.int64)
        self._factor, self._kept = _cholesky(self._gram(), dependent**2)

    def _places(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return law, order and kind (0 for a cosine, 1 for a sine) of every line."""
        count = len(self._laws)
        law = [
            *range(count),
            *(a for _ in range(self._highest) for a in range(count) for _ in 'cs'),
        ]
        kind = [0] * count + [0, 1] * (count * self._highest)
        return np.array(law), np.concatenate([[0], self.orders]), np.array(kind)

    def _gram(self) -> FloatArray:
        """Return the inner products of all lines, from sums of at most twice the highest order."""
        law, order, kind = self._places()
        even, odd = _product_sums(self._laws, self._phase, 2 * self._highest)
        less, more = order[:, None] - order, order[:, None] + order
        pair = law[:, None], law
        c_less, c_more = even[(*pair, np.abs(less))], even[(*pair, more)]
        s_less, s_more = np.sign(less) * odd[(*pair, np.abs(less))], odd[(*pair, more)]
        first, second = kind[:, None], kind
        found = np.where(second, s_more - s_less, c_less + c_more)
        found = np.where(first, np.where(second, c_less - c_more, s_more + s_less), found)
        return np.asarray(0.5 * found, dtype=np.float64)

    def split(self, signal: FloatArray) -> tuple[FloatArray, FloatArray]:  # signal (n,)
        """Return the coefficients of orthonormal lines, shape (q,), and the rest of a signal."""
        law, order, kind = self._places()
        even, odd = _signal_sums(self._laws, signal, self._phase, self._highest)
        right = np.where(kind, odd[law, order], even[law, order])
        shares, kept = np.zeros(right.size), self._kept
        lower = self._factor[np.ix_(kept, kept)]
        shares[kept] = solve_square(lower, right[kept]).values
        weights = np.zeros(right.size)
        weights[kept] = solve_square(lower.T, shares[kept]).values
        by_cos, by_sin = np.zeros_like(even), np.zeros_like(odd)
        np.add.at(by_cos, (law[kind == 0], order[kind == 0]), weights[kind == 0])
        np.add.at(by_sin, (law[kind == 1], order[kind == 1]), weights[kind == 1])
        return shares[1:], _less_lines(signal, self._laws, self._phase, by_cos, by_sin)


def _cholesky(gram: FloatArray, least: float) -> tuple[FloatArray, BoolArray]:
    """Return the lower factor of inner products, and the rows that do not depend on others.

    A row depends on those before it if at most the share `least` of its square remains.
    """
    count = len(gram)
    lower, kept = np.zeros((count, count)), np.zeros(count, dtype=bool)
    for j in range(count):
        for i in np.flatnonzero(kept[:j]):
            lower[j, i] = (gram[j, i] - lower[j, :i] @ lower[i, :i]) / lower[i, i]
        left = float(gram[j, j] - lower[j, :j] @ lower[j, :j])
        if left > least * gram[j, j]:
            kept[j], lower[j, j] = True, np.sqrt(left)
    return lower, kept


@leaf
def _turn(phase: FloatArray, first: int, by: FloatArray, turn: FloatArray) -> None:
    """Set the first turn of a block of samples, and the zeroth, as rows of cosine and sine."""
    for k in range(by.shape[1]):
        by[0, k], by[1, k] = cos(phase[first + k]), sin(phase[first + k])
        turn[0, k], turn[1, k] = 1.0, 0.0


@leaf
def _next(turn: FloatArray, by: FloatArray) -> None:
    """Multiply the turns of a block by the first one."""
    for k in range(by.shape[1]):
        real = turn[0, k] * by[0, k] - turn[1, k] * by[1, k]
        turn[1, k] = turn[0, k] * by[1, k] + turn[1, k] * by[0, k]
        turn[0, k] = real


@jit
def _product_sums(
    laws: FloatArray, phase: FloatArray, highest: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of two laws with cosines and with sines, shapes (a, a, highest + 1)."""
    count, n = laws.shape
    even = np.zeros((count, count, highest + 1))
    odd = np.zeros((count, count, highest + 1))
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn, both = np.empty((2, size)), np.empty((2, size)), np.empty(size)
        products = np.empty((count, count, size))
        for i in range(count):
            for j in range(i + 1):
                products[i, j] = laws[i, begin : begin + size] * laws[j, begin : begin + size]
        _turn(phase, begin, by, turn)
        for m in range(highest + 1):
            for i in range(count):
                for j in range(i + 1):
                    both = products[i, j]
                    even[i, j, m] += inner(both, turn[0])
                    odd[i, j, m] += inner(both, turn[1])
            _next(turn, by)
    for i in range(count):
        for j in range(i):
            even[j, i], odd[j, i] = even[i, j], odd[i, j]
    return even, odd


@jit
def _signal_sums(
    laws: FloatArray, signal: FloatArray, phase: FloatArray, highest: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of a signal with each law and turn, shapes (a, highest + 1)."""
    count, n = laws.shape
    even, odd = np.zeros((count, highest + 1)), np.zeros((count, highest + 1))
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn = np.empty((2, size)), np.empty((2, size))
        weighed = laws[:, begin : begin + size] * signal[begin : begin + size]
        _turn(phase, begin, by, turn)
        for m in range(highest + 1):
            for i in range(count):
                even[i, m] += inner(weighed[i], turn[0])
                odd[i, m] += inner(weighed[i], turn[1])
            _next(turn, by)
    return even, odd


@jit
def _less_lines(
    signal: FloatArray, laws: FloatArray, phase: FloatArray, by_cos: FloatArray, by_sin: FloatArray
) -> FloatArray:
    """Return a signal without lines, for the weights of their cosines and sines."""
    count, n = laws.shape
    left = signal.copy()
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn = np.empty((2, size)), np.empty((2, size))
        _turn(phase, begin, by, turn)
        lines = np.zeros((count, size))
        for m in range(by_cos.shape[1]):
            for i in range(count):
                c, s, line = by_cos[i, m], by_sin[i, m], lines[i]
                for k in range(size):
                    line[k] += c * turn[0, k] + s * turn[1, k]
            _next(turn, by)
        for i in range(count):
            for k in range(size):
                left[begin + k] -= laws[i, begin + k] * lines[i, k]
    return left
