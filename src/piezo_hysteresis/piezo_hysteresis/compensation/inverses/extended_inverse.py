"""The inverse of the extended Bouc-Wen model, Fujii 2018 (16), (17) and Tatebatake 2017 (12)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, take
from piezo_hysteresis.compensation.inverses.physical import keep_sign, saturation
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit

NAMES = ('A1', 'A', 'A0', 'beta', 'gamma', 'c1', 'c2')

# Indices in the memory; the counters are first.
_CLAMPED, _STROKE, _U, _H, _D1, _D2, _D3 = range(7)


@jit
def _invert_extended(
    reference: FloatArray,
    voltage: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
    low: float,
    high: float,
) -> None:
    """Solve Fujii 2018 (3) for u[k] with y = d, on the branch with a consistent sign.

    A falling model is that of the reversed displacement: all gains and gamma change their sign.
    """
    way = 1.0 if p[0] > 0.0 else -1.0
    a1, a, a0, beta, gamma = way * p[0], way * p[1], way * p[2], p[3], way * p[4]
    c1, c2, minimum = p[5], p[6], p[7]
    u, h = memory[_U], memory[_H]
    d1, d2, d3 = memory[_D1], memory[_D2], memory[_D3]
    for k in range(reference.shape[1]):
        d = way * reference[0, k]
        r = d - d1 - c1 * d2 - c2 * d3 + h - a1 * u
        sign = 1.0 if r > 0.0 else -1.0
        slope = a1 - a - sign * a0 + gamma * abs(h) + sign * beta * h
        if slope < minimum:
            slope = minimum
            if r != 0.0:
                memory[_CLAMPED] += 1.0
        new = u + r / slope
        if new > high or new < low:
            new = min(max(new, low), high)
            memory[_STROKE] += 1.0
        du = new - u
        h += a * du + a0 * abs(du) - gamma * abs(h) * du - beta * abs(du) * h
        u = new
        d3, d2, d1 = d2, d1, d
        voltage[k] = u
    memory[_U], memory[_H] = u, h
    memory[_D1], memory[_D2], memory[_D3] = d1, d2, d3


@jit
def _invert_printed(
    reference: FloatArray,
    voltage: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
    low: float,
    high: float,
) -> None:
    """Divide the remainder of (7) by A1, y = d, h of the previous sample: Tatebatake 2017 (12)."""
    a1, a, a0, beta, gamma, c1, c2 = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    u, h = memory[_U], memory[_H]
    d1, d2, d3 = memory[_D1], memory[_D2], memory[_D3]
    for k in range(reference.shape[1]):
        d = reference[0, k]
        new = (d - d1 - c1 * d2 - c2 * d3 + h) / a1
        if new > high or new < low:
            new = min(max(new, low), high)
            memory[_STROKE] += 1.0
        du = new - u
        h += a * du + a0 * abs(du) - gamma * abs(h) * du - beta * abs(du) * h
        u = new
        d3, d2, d1 = d2, d1, d
        voltage[k] = u
    memory[_U], memory[_H] = u, h
    memory[_D1], memory[_D2], memory[_D3] = d1, d2, d3


_KERNELS = {'solved': _invert_extended, 'printed': _invert_printed}


class ExtendedInverse(InverseLink):
    """Feedforward by the direct inverse of the extended model.

    The law ``solved``, Fujii 2018 (16), (17), solves the model for the voltage of this sample, h
    of this sample included. ``printed``, Tatebatake 2017 (12), uses h of the previous sample and
    divides by A1: the hysteresis is one sample late, and no branch is selected.

    Fujii 2018 (15), (16), (17) are one law: with ``r = d[k] - d[k-1] - c1 d[k-2] - c2 d[k-3]
    + h[k-1] - A1 u[k-1]`` the increment of the voltage is ``r / D``, where D is the slope of the
    branch with the sign of r. If D is not above `minimum_slope`, the model has no inverse; D is
    then clamped and counted, and its sign is kept.
    """

    memory_size = 7

    def __init__(
        self,
        parameters: Mapping[str, float],
        dt: float,  # [s]
        minimum_slope: float | None = None,  # [m/V]
        *,
        law: str = 'solved',
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if law not in _KERNELS:
            raise CompensationError(
                f'there is no inverse {law!r} of the extended model; choose solved or printed'
            )
        self.run = _KERNELS[law]
        self._minimum_slope = minimum_slope
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        with_defaults = {'A0': 0.0, **parameters}
        packed = take(with_defaults, NAMES, 'the inverse of the extended model')
        if packed[0] == 0.0:
            raise CompensationError('A1 is 0, so the model has no inverse; identify again')
        minimum = 0.1 * abs(packed[0]) if self._minimum_slope is None else self._minimum_slope
        if not minimum > 0:
            raise CompensationError(f'minimum_slope must be positive, got {minimum:g} m/V')
        return np.array([*packed, minimum])

    def _carry_over(self, old: FloatArray, new: FloatArray) -> None:
        keep_sign('A1', old, new)
        self.own[_H] *= saturation(new) / max(saturation(old), 1e-300)


_SLOPE_SELECTOR_CLAMPED, _SLOPE_SELECTOR_STROKE, _D, _SLOPE_SELECTOR_U, _SLOPE_SELECTOR_H, _OWN = (
    range(6)
)
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
    last, u, h = memory[_D], memory[_SLOPE_SELECTOR_U], memory[_SLOPE_SELECTOR_H]
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
            memory[_SLOPE_SELECTOR_CLAMPED] += 1.0
        u += rise
        h = moved
        last = reference[0, k]
        safe = min(max(u, low), high)
        if safe != u:
            memory[_SLOPE_SELECTOR_STROKE] += 1.0
        voltage[k] = safe
    memory[_D], memory[_SLOPE_SELECTOR_U], memory[_SLOPE_SELECTOR_H] = last, u, h


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
