"""Inverse Bouc-Wen model of Xiao 2014, with parameters selected by the slope of the reference."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, take
from piezo_hysteresis.jit import jit

_CLAMPED, _STROKE, _D, _U, _H, _OWN = range(6)
_NAMES = ('inverse_gain', 'inverse_A', 'inverse_beta', 'inverse_gamma')


@jit
def _select(
    reference: FloatArray,
    voltage: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
    low: float,
    high: float,
) -> None:
    """Sum the segments of Xiao 2014; `p` holds rows of slope, c, a, b, g, by increasing slope."""
    last, u, h = memory[_D], memory[_U], memory[_H]
    rows = p.size // 5
    for k in range(voltage.size):
        step = reference[0, k] - last
        slope = max(abs(reference[1, k]), abs(step) / dt)
        row = 0
        while row < rows - 2 and slope > p[5 * (row + 1)]:
            row += 1
        at = 5 * row
        share = (slope - p[at]) / (p[at + 5] - p[at])
        share = min(max(share, 0.0), 1.0)
        c, a, b, g = (
            p[at + 1] + share * (p[at + 6] - p[at + 1]),
            p[at + 2] + share * (p[at + 7] - p[at + 2]),
            p[at + 3] + share * (p[at + 8] - p[at + 3]),
            p[at + 4] + share * (p[at + 9] - p[at + 4]),
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
    """Xiao 2014 (3), figure 11: reference in segments, each inverted by the row of its slope."""

    memory_size = _OWN
    run = staticmethod(_select)

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        what = 'the inverse Bouc-Wen law'
        if 'selector_slope' not in parameters:
            row = take(parameters, _NAMES, what)
            return np.array([0.0, *row, 1.0, *row])
        (span,) = take(parameters, ('selector_slope',), what)
        rows: list[float] = []
        for i in range(1, KNOTS + 1):
            row = take(parameters, tuple(f'{name}_at{i}' for name in _NAMES), what)
            rows += [span * i / KNOTS, *row]
        return np.array(rows)
