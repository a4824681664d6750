"""003's inverse Bouc-Wen model whose parameters follow the slope of the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.bouc_wen_exact import kernel as bouc_wen
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS
from piezo_hysteresis.compensation.inverse import InverseLink, take
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import failing_as

_CLAMPED, _STROKE, _D, _U, _H, _OWN = range(6)
_NAMES = ('inverse_gain', 'inverse_A', 'inverse_beta', 'inverse_gamma')


@dataclass(frozen=True)
class InverseBoucWen:
    """``u = c r - h, dh = a dr - b |dr| h - g dr |h|`` with displacement in and voltage out.

    Attributes
    ----------
    slope : float
        Slope of the reference at which it was fitted [m/s].
    c, a : float
        [V/m].
    b, g : float
        [1/m].
    """

    slope: float
    c: float
    a: float
    b: float
    g: float


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
    """Add up 003's line segments; rows of `table` are slope, c, a, b, g, slopes ascending."""
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
    """003 figure 11: line segments of the reference, each inverted by the row of its slope.

    Parameters
    ----------
    parameters : mapping of str to float
        Those of the blocks ``inverse_selector`` or ``inverse_bouc_wen`` (see `selector_table` to
        write rows so) and, where it is not 0, ``offset`` [m].
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


def selector_table(rows: Sequence[InverseBoucWen]) -> dict[str, float]:
    """Return the parameters of the block ``inverse_selector`` that rows of any slopes describe.

    Its knots are equally spaced up to the steepest row; between rows they are interpolated.

    Parameters
    ----------
    rows : sequence of InverseBoucWen
        At least two, of different slopes.

    Raises
    ------
    CompensationError
        If there are fewer than two rows, or two of one slope.
    """
    ordered = sorted(rows, key=lambda row: row.slope)
    slopes = np.array([row.slope for row in ordered])
    if len(ordered) < 2 or np.any(np.diff(slopes) <= 0):
        raise CompensationError(
            'the slope selector needs fits at two or more different slopes; record triangles of '
            'several frequencies'
        )
    span = float(slopes[-1])
    knots = span * np.arange(1, KNOTS + 1) / KNOTS
    table = {'selector_slope': span}
    for name, key in zip(_NAMES, ('c', 'a', 'b', 'g'), strict=True):
        column = np.interp(knots, slopes, [getattr(row, key) for row in ordered])
        table.update({f'{name}_at{i}': float(v) for i, v in enumerate(column, start=1)})
    return table


def fit_inverse(
    displacement: FloatArray, voltage: FloatArray, slope: float, warm_up: int = 0
) -> InverseBoucWen:
    """Fit one row of the selector to a record of triangles at one slope.

    Parameters
    ----------
    displacement, voltage : ndarray, shape (n,)
        Measured displacement [m] and the voltage of the same instants [V].
    slope : float
        Slope of the displacement between the tips [m/s].
    warm_up : int
        Samples at the start that do not count.

    Raises
    ------
    CompensationError
        If the displacement does not move, or the fit fails.
    """
    from scipy.optimize import least_squares

    stroke, swing = float(np.ptp(displacement)), float(np.ptp(voltage))
    if not (stroke > 0 and swing > 0):
        raise CompensationError('the record does not move; record triangles over the stroke')
    x = np.ascontiguousarray(displacement / stroke)
    x = x - x[0]
    u = voltage / swing

    def model(p: FloatArray) -> FloatArray:
        answer = np.empty(x.size)
        gamma = p[3] * p[2]
        bouc_wen(x, answer, np.zeros(2), np.array([p[0], p[1], 0.0, p[2], gamma]), 1.0, 0.0)
        return answer

    def residual(p: FloatArray) -> FloatArray:
        missed: FloatArray = (model(p) + p[4] - u)[warm_up:]
        return missed

    # With |gamma| below beta and a negative a the voltage rises with the displacement.
    low, high = [1e-2, -50.0, 1e-2, -0.99, -np.inf], [10.0, 0.0, 100.0, 0.99, np.inf]
    with failing_as(CompensationError(f'the inverse at {slope:g} m/s could not be fitted')):
        fits = [
            least_squares(residual, [*start, u[0]], bounds=(low, high), x_scale='jac')
            for start in ([1.0, -0.2, 2.0, 0.2], [0.8, -1.0, 5.0, -0.5], [0.5, -2.0, 10.0, 0.5])
        ]
    best = min(fits, key=lambda fit: float(fit.cost))
    c, a, b, ratio = (float(value) for value in best.x[:4])
    g = ratio * b
    return InverseBoucWen(slope, c * swing / stroke, a * swing / stroke, b / stroke, g / stroke)
