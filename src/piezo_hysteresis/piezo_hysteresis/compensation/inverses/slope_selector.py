"""Xiao 2014's inverse Bouc-Wen model whose parameters follow the slope of the reference."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS
from piezo_hysteresis.compensation.inverses.base import InverseLink, take
from piezo_hysteresis.jit import jit

_CLAMPED, _STROKE, _D, _U, _H, _OWN = range(6)
_NAMES = ('inverse_gain', 'inverse_A', 'inverse_beta', 'inverse_gamma')


@jit
def _select(
    reference: FloatArray,
    voltage: FloatArray,
    memory: FloatArray,
    table: FloatArray,
    dt: float,
    low: float,
    high: float,
) -> None:
    """Add up Xiao 2014's segments; rows of `table` are slope, c, a, b, g, slopes ascending."""
    last, u, h = memory[_D], memory[_U], memory[_H]
    rows = table.shape[0]
    for k in range(voltage.size):
        step = reference[0, k] - last
        slope = max(abs(reference[1, k]), abs(step) / dt)
        row = 0
        while row < rows - 2 and slope > table[row + 1, 0]:
            row += 1
        share = (slope - table[row, 0]) / (table[row + 1, 0] - table[row, 0])
        share = min(max(share, 0.0), 1.0)
        c, a, b, g = (
            table[row, 1] + share * (table[row + 1, 1] - table[row, 1]),
            table[row, 2] + share * (table[row + 1, 2] - table[row, 2]),
            table[row, 3] + share * (table[row + 1, 3] - table[row, 3]),
            table[row, 4] + share * (table[row + 1, 4] - table[row, 4]),
        )
        moved = exact_step(h, step, a, 0.0, b, g)
        rise = c * step - (moved - h)
        if rise * step < 0.0:
            rise = 0.0
            memory[_CLAMPED] += 1.0
        u += rise
        h = moved
        last = reference[0, k]
        safe = min(max(u, low), high)
        if safe != u:
            memory[_STROKE] += 1.0
        voltage[k] = safe
    memory[_D], memory[_U], memory[_H] = last, u, h


class SlopeSelectedInverse(InverseLink):
    """Xiao 2014 figure 11: line segments of the reference, each inverted by the row of its slope.

    Parameters
    ----------
    parameters : mapping of str to float
        Those of the blocks ``inverse_selector`` or ``inverse_bouc_wen`` and, where it is not 0,
        ``offset`` [m]; `identification.inverse_rows` has them from records.
    dt, limits, start, transition
        As in `InverseLink`.

    Raises
    ------
    CompensationError
        If a parameter is missing or not finite.
    """

    memory_size = _OWN

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        what = 'the inverse Bouc-Wen law'
        if 'selector_slope' not in parameters:
            row = take(parameters, _NAMES, what)
            return np.array([[0.0, *row], [1.0, *row]])
        (span,) = take(parameters, ('selector_slope',), what)
        rows = []
        for i in range(1, KNOTS + 1):
            row = take(parameters, tuple(f'{name}_at{i}' for name in _NAMES), what)
            rows.append([span * i / KNOTS, *row])
        return np.array(rows)

    def _run(self, reference: FloatArray, voltage: FloatArray, memory: FloatArray) -> None:
        _select(reference, voltage, memory, self._packed, self.dt, self._low, self._high)
