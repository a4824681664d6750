"""Feedforward for a hysteresis and a structure, Zhou 2021 (8), and for extended models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import exact_step
from piezo_hysteresis.blocks._plays import COUNT
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.compensation.inverses import hysteresis_inverse as hysteresis
from piezo_hysteresis.compensation.inverses.block_inverse import (
    CORNERS,
    STATE_SIZE,
    invert_structure,
    mode_coefficients,
)
from piezo_hysteresis.compensation.inverses.inverse_link import (
    InverseLink,
    Motion,
    Pack,
    Run,
    take,
)
from piezo_hysteresis.compensation.link import IMPOSSIBLE, OK, Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch

Law = Literal['exact', 'euler', 'delayed', 'plays', 'gain']
BOUC_WEN = ('A1', 'A', 'A0', 'beta', 'gamma')
PLAYS = ('pi_range', 'w0', *(f'w{j}' for j in range(1, COUNT + 1)))
# One mode, or none where all are 0; then the delay.
STRUCTURE = ('mass', 'damping', 'stiffness', 'natural_frequency', 'damping_ratio', 'delay')

# Indices of the values before those of the hysteresis, and in the memory, where the structure
# follows the hysteresis.
MINIMUM, K1, K2, LEAD, FIRST = range(5)


def _behind_structure(law: str, size: int) -> Run:
    """Return the inverse of a hysteresis with a given memory size, followed by a structure.

    A falling model is that of the reversed displacement: all gains and gamma change their sign.
    """
    (solve, follow), plays = hysteresis.KERNELS[law], law == 'plays'
    count, slope = (len(PLAYS), 1) if plays else (len(BOUC_WEN), 0)
    kept = PLAYS.index('pi_range') if plays else BOUC_WEN.index('beta')

    @inline_jit
    def run(
        at: Motion, memory: FloatArray, p: FloatArray, dt: float, low: float, high: float
    ) -> float:
        w = invert_structure(at, memory[size:], p[K1], p[K2], p[LEAD], dt)
        sign, rising = 1.0 if p[FIRST + slope] > 0.0 else -1.0, scratch(count)
        for k in range(count):
            rising[k] = p[FIRST + k] if k == kept else sign * p[FIRST + k]
        own = memory[:size]
        u = solve(sign * w, own, rising, p[MINIMUM])
        if u > high or u < low:
            u = min(max(u, low), high)
            own[hysteresis.STROKE] += 1.0
        follow(u, own, rising)
        own[hysteresis.U] = u
        return float(u)

    return run


_SIZES = {law: hysteresis.H + (COUNT if law == 'plays' else 1) for law in hysteresis.KERNELS}
_RUNS = {law: _behind_structure(law, _SIZES[law]) for law in hysteresis.KERNELS}


class PhysicalInverse(InverseLink):
    """Feedforward by inversion of a hysteresis and a structure in series, Zhou 2021 (8).

    The structure (one mode, or none) is inverted with the analytic derivatives of the reference in
    the middle of the hold interval; the hysteresis sample by sample.

    ``exact``: Bouc-Wen by its exact step; ``euler``: by the papers' step and branch rule;
    ``delayed``: with h of the previous sample, Rakotondrabe's multiplicative form and Zhou 2021
    (8) as printed; ``plays``: Prandtl-Ishlinskii; ``gain``: no hysteresis.
    """

    def __init__(
        self,
        parameters: Mapping[str, float],
        dt: float,  # [s]
        *,
        law: Law = 'exact',
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if law not in hysteresis.KERNELS:
            raise CompensationError(
                f'there is no inverse {law!r} of a hysteresis{choices(law, hysteresis.KERNELS)}'
            )
        self.law = law
        self.run, self.pack = _RUNS[law], _PACKS[law]
        own = PLAYS if law == 'plays' else BOUC_WEN
        self.reads, self.packed_size = (*own, *STRUCTURE), FIRST + len(own)
        self.leading = 1 if law == 'plays' else 0
        self.live = () if law == 'gain' else (*self.reads, 'offset')
        self.memory_size = _SIZES[law] + STATE_SIZE
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def _values(self, parameters: Mapping[str, float]) -> list[float]:
        given, own = {'A0': 0.0, **parameters}, self.reads[: -len(STRUCTURE)]
        if self.law == 'gain':
            given, own = {**parameters, **dict.fromkeys(BOUC_WEN[1:], 0.0)}, BOUC_WEN
        found = take(given, own, f'the inverse {self.law!r}')
        structure_coefficients(parameters)
        return [*found, *(float(parameters.get(name, 0.0)) for name in STRUCTURE)]

    def _reason(self, values: FloatArray) -> str:
        if self.law == 'plays':
            if monotonic_plays(values[: len(PLAYS)]):
                return ''
            return (
                'the Prandtl-Ishlinskii model has no inverse: pi_range must be positive, and '
                'w0 and the sum of all weights must have one sign; identify again'
            )
        # The delayed law only divides by A1.
        a1, a, a0 = (float(values[0]), 0.0, 0.0) if self.law == 'delayed' else values[:3].tolist()
        if monotonic_bouc_wen(a1, a, a0):
            return ''
        return (
            f'A1 = {a1:g} m/V and the slope from rest, A1 - A -+ A0 = {a1 - a - a0:g} and '
            f'{a1 - a + a0:g} m/V, have not one sign: the model turns back, so it has no '
            'inverse; identify with that bound'
        )

    def counters(self) -> dict[str, int]:
        """Return the error counters; ``corners`` counts steps of the slope of the reference."""
        return {**super().counters(), 'corners': int(self.own[_SIZES[self.law] + CORNERS])}


def _packing(law: str) -> Pack:
    """Return the kernel that packs the parameters of `PhysicalInverse`."""
    plays, solved = law == 'plays', law != 'delayed'
    count, slope = (len(PLAYS), 1) if plays else (len(BOUC_WEN), 0)

    @jit
    def pack(values: FloatArray, p: FloatArray, own: FloatArray, dt: float, first: bool) -> int:
        new, delay = values[:count], values[count + 5]
        k1, k2 = coefficients(values[count:])
        if not (k1 >= 0.0 and k2 >= 0.0):
            return IMPOSSIBLE
        if plays and not monotonic_plays(new):
            return IMPOSSIBLE
        if not first and new[slope] * p[FIRST + slope] < 0.0:
            return IMPOSSIBLE
        inner, shift = (new[1], new[2]) if solved else (0.0, 0.0)
        if not plays and not monotonic_bouc_wen(new[0], inner, shift):
            return IMPOSSIBLE
        # The states of the plays are voltages, which are unchanged.
        if not (plays or first):
            own[hysteresis.H] *= saturation(new) / max(saturation(p[FIRST:]), 1e-300)
        p[MINIMUM] = 0.1 * abs(new[slope])
        p[K1], p[K2] = k1, k2
        p[LEAD] = (0.5 * dt if k2 > 0.0 else 0.0) + delay
        for k in range(count):
            p[FIRST + k] = new[k]
        return OK

    return pack


@jit
def coefficients(structure: FloatArray) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``w = d + k1 d' + k2 d''`` for values of `STRUCTURE`."""
    mass, damping, stiffness, natural_frequency, damping_ratio = structure[:5]
    if stiffness != 0.0:
        return damping / stiffness, mass / stiffness
    if natural_frequency == 0.0:
        return 0.0, 0.0
    return mode_coefficients(natural_frequency, damping_ratio)


_PACKS = {law: _packing(law) for law in hysteresis.KERNELS}


def structure_coefficients(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``w = d + k1 d' + k2 d''`` for the structure of a model."""
    if 'mass' in parameters:
        mass, _, stiffness = take(parameters, STRUCTURE[:3], 'the structure')
        if not (mass > 0 and stiffness > 0):
            raise CompensationError('mass and stiffness must be positive')
    elif parameters.get('natural_frequency', 0.0) != 0.0:
        frequency, _ = take(parameters, STRUCTURE[3:5], 'the mode')
        if not frequency > 0:
            raise CompensationError(f'natural_frequency must be positive, got {frequency:g} Hz')
    k1, k2 = coefficients(np.array([parameters.get(name, 0.0) for name in STRUCTURE], np.float64))
    return float(k1), float(k2)


@jit
def saturation(bouc_wen: FloatArray) -> float:
    """Return the saturation level of h [m], by which h is scaled after a change."""
    a, a0, beta = bouc_wen[1], bouc_wen[2], bouc_wen[3]
    gamma = bouc_wen[4] if bouc_wen[0] > 0.0 else -bouc_wen[4]
    return float(max(abs(a) + abs(a0), 1e-15) / max(beta + gamma, 1e-3))


@jit
def monotonic_plays(plays: FloatArray) -> bool:
    """Return whether a Prandtl-Ishlinskii model, range and weights, has an inverse."""
    return bool(plays[0] > 0.0 and plays[1] * np.sum(plays[1:]) > 0.0)


@jit
def monotonic_bouc_wen(a1: float, a: float, a0: float) -> bool:
    """Return whether the slope of a Bouc-Wen model from rest has the sign of A1."""
    sign = 1.0 if a1 > 0.0 else -1.0
    return bool(a1 != 0.0 and sign * (a1 - a) - abs(a0) > 0.0)


def least_slope(parameters: Mapping[str, float]) -> float:
    """Return the smallest slope dw/du that a Bouc-Wen model can take [m/V].

    It is the slope just after a reversal of a saturated h: A1 - A - |A0| - (beta - gamma) h_max.
    If it is not positive, the model has no inverse near the tips of its largest loops.
    """
    a1, a, a0, beta, gamma = take({'A0': 0.0, **parameters}, BOUC_WEN, 'the slope')
    if a1 < 0.0:  # that of the reversed displacement
        a1, a, a0, gamma = -a1, -a, -a0, -gamma
    highest = (a + abs(a0)) / (beta + gamma) if beta + gamma > 0 else math.inf
    steepest = max(beta - gamma, 0.0)
    return a1 - a - abs(a0) - (steepest * highest if steepest > 0 else 0.0)


NAMES = ('A1', 'A', 'A0', 'beta', 'gamma', 'c1', 'c2')

# Indices in the memory; the counters are first.
_CLAMPED, _STROKE, _U, _H, _D1, _D2, _D3 = range(7)


def _extended(solved: bool) -> Run:
    """Return the inverse of the extended model, Fujii 2018 (3), `solved` or as printed.

    A falling model is that of the reversed displacement: all gains and gamma change their sign.
    """

    @inline_jit
    def run(
        at: Motion, memory: FloatArray, p: FloatArray, dt: float, low: float, high: float
    ) -> float:
        way = 1.0 if p[0] > 0.0 or not solved else -1.0
        a1, a, a0, beta, gamma = way * p[0], way * p[1], way * p[2], p[3], way * p[4]
        c1, c2, minimum = p[5], p[6], p[7]
        u, h = memory[_U], memory[_H]
        d1, d2, d3 = memory[_D1], memory[_D2], memory[_D3]
        d = way * at.displacement
        held = d - d1 - c1 * d2 - c2 * d3 + h
        if solved:
            # Fujii 2018 (3) for u[k] with y = d, on the branch with a consistent sign
            r = held - a1 * u
            sign = 1.0 if r > 0.0 else -1.0
            slope = a1 - a - sign * a0 + gamma * abs(h) + sign * beta * h
            if slope < minimum:
                slope = minimum
                if r != 0.0:
                    memory[_CLAMPED] += 1.0
            new = u + r / slope
        else:
            # the remainder of (7) by A1 with y = d, h of the previous sample
            new = held / a1
        if new > high or new < low:
            new = min(max(new, low), high)
            memory[_STROKE] += 1.0
        du = new - u
        h += a * du + a0 * abs(du) - gamma * abs(h) * du - beta * abs(du) * h
        memory[_U], memory[_H] = new, h
        memory[_D1], memory[_D2], memory[_D3] = d, d1, d2
        return float(new)

    return run


_EXTENDED = {'solved': _extended(True), 'printed': _extended(False)}


@jit
def _pack_extended(
    values: FloatArray, p: FloatArray, own: FloatArray, dt: float, first: bool
) -> int:
    if values[0] == 0.0 or (not first and values[0] * p[0] < 0.0):
        return IMPOSSIBLE
    if not first:
        own[_H] *= saturation(values) / max(saturation(p), 1e-300)
    for k in range(values.size):
        p[k] = values[k]
    p[values.size] = 0.1 * abs(values[0])
    return OK


class ExtendedInverse(InverseLink):
    """Feedforward by the direct inverse of the extended model.

    The law ``solved``, Fujii 2018 (16), (17), solves the model for the voltage of this sample, h
    of this sample included. ``printed``, Tatebatake 2017 (12), uses h of the previous sample and
    divides by A1: the hysteresis is one sample late, and no branch is selected.

    Fujii 2018 (15), (16), (17) are one law: with ``r = d[k] - d[k-1] - c1 d[k-2] - c2 d[k-3]
    + h[k-1] - A1 u[k-1]`` the increment of the voltage is ``r / D``, where D is the slope of the
    branch with the sign of r. If D is not above a tenth of A1, the model has no inverse; D is then
    clamped and counted, and its sign is kept.
    """

    memory_size, packed_size = 7, len(NAMES) + 1
    pack, reads, live = staticmethod(_pack_extended), NAMES, (*NAMES, 'offset')

    def __init__(
        self,
        parameters: Mapping[str, float],
        dt: float,  # [s]
        *,
        law: str = 'solved',
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if law not in _EXTENDED:
            raise CompensationError(
                f'there is no inverse {law!r} of the extended model; choose solved or printed'
            )
        self.run = _EXTENDED[law]
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def _values(self, parameters: Mapping[str, float]) -> list[float]:
        return take({'A0': 0.0, **parameters}, NAMES, 'the inverse of the extended model')

    def _reason(self, values: FloatArray) -> str:
        return '' if values[0] else 'A1 is 0, so the model has no inverse; identify again'


_SLOPE_SELECTOR_CLAMPED, _SLOPE_SELECTOR_STROKE, _D, _SLOPE_SELECTOR_U, _SLOPE_SELECTOR_H, _OWN = (
    range(6)
)
_NAMES = ('inverse_gain', 'inverse_A', 'inverse_beta', 'inverse_gamma')


@inline_jit
def _select(
    at: Motion, memory: FloatArray, p: FloatArray, dt: float, low: float, high: float
) -> float:
    """Sum the segments of Xiao 2014; `p` holds rows of slope, c, a, b, g, by increasing slope."""
    last, u, h = memory[_D], memory[_SLOPE_SELECTOR_U], memory[_SLOPE_SELECTOR_H]
    rows = p.size // 5
    step = at.displacement - last
    slope = max(abs(at.velocity), abs(step) / dt)
    row = 0
    while row < rows - 2 and slope > p[5 * (row + 1)]:
        row += 1
    i = 5 * row
    share = (slope - p[i]) / (p[i + 5] - p[i])
    share = min(max(share, 0.0), 1.0)
    c, a, b, g = (
        p[i + 1] + share * (p[i + 6] - p[i + 1]),
        p[i + 2] + share * (p[i + 7] - p[i + 2]),
        p[i + 3] + share * (p[i + 8] - p[i + 3]),
        p[i + 4] + share * (p[i + 9] - p[i + 4]),
    )
    moved = exact_step(h, step, a, 0.0, b, g)
    rise = c * step - (moved - h)
    if rise * step < 0.0:
        rise = 0.0
        memory[_SLOPE_SELECTOR_CLAMPED] += 1.0
    u += rise
    safe = min(max(u, low), high)
    if safe != u:
        memory[_SLOPE_SELECTOR_STROKE] += 1.0
    memory[_D], memory[_SLOPE_SELECTOR_U], memory[_SLOPE_SELECTOR_H] = at.displacement, u, moved
    return float(safe)


class SlopeSelectedInverse(InverseLink):
    """Xiao 2014 (3), figure 11: reference in segments, each inverted by the row of its slope."""

    memory_size = _OWN
    run = staticmethod(_select)

    def _packed(self, parameters: Mapping[str, float], before: FloatArray | None) -> FloatArray:
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
