"""Feedforward for a hysteresis and a structure, Zhou 2021 (8), and for extended models."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, Packing, Run, take
from piezo_hysteresis.compensation.link import IMPOSSIBLE, OK, Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch

Law = Literal['exact', 'euler', 'delayed', 'plays', 'gain']
_Kernel = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float, float, float], None]

_KERNELS: dict[str, _Kernel] = {
    'exact': hysteresis.invert_exact,
    'euler': hysteresis.invert_euler,
    'delayed': hysteresis.invert_delayed,
    'plays': hysteresis.invert_plays,
    'gain': hysteresis.invert_gain,
}
BOUC_WEN = ('A1', 'A', 'A0', 'beta', 'gamma')
PLAYS = ('pi_range', 'w0', *(f'w{j}' for j in range(1, COUNT + 1)))

# Indices of the values before those of the hysteresis, and in the memory, where the structure
# follows the hysteresis.
MINIMUM, K1, K2, LEAD, FIRST = range(5)


def _behind_structure(law: str, size: int) -> Run:
    """Return the inverse of a hysteresis with a given memory size, followed by a structure.

    A falling model is that of the reversed displacement: all gains and gamma change their sign.
    """
    invert, plays = _KERNELS[law], law == 'plays'
    count, slope = (len(PLAYS), 1) if plays else (len(BOUC_WEN), 0)
    kept = PLAYS.index('pi_range') if plays else BOUC_WEN.index('beta')

    @jit
    def run(
        reference: FloatArray, voltage: FloatArray, memory: FloatArray, p: FloatArray, dt: float,
        low: float, high: float,
    ) -> None:  # fmt: skip
        invert_structure(reference, voltage, memory[size:], p[K1], p[K2], p[LEAD], dt)
        sign, rising = 1.0 if p[FIRST + slope] > 0.0 else -1.0, scratch(count)
        for k in range(count):
            rising[k] = p[FIRST + k] if k == kept else sign * p[FIRST + k]
        for k in range(voltage.size):
            voltage[k] *= sign
        invert(voltage, voltage, memory[:size], rising, p[MINIMUM], low, high)

    return run


_SIZES = {law: hysteresis.H + (COUNT if law == 'plays' else 1) for law in _KERNELS}
_RUNS = {law: _behind_structure(law, _SIZES[law]) for law in _KERNELS}


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
        minimum_slope: float | None = None,  # [m/V]
        lead: float | None = None,  # [s]
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if law not in _KERNELS:
            raise CompensationError(
                f'there is no inverse {law!r} of a hysteresis{choices(law, _KERNELS)}'
            )
        self.law = law
        self.run = _RUNS[law]
        self._minimum_slope = minimum_slope
        self._lead_given = lead
        self.memory_size = _SIZES[law] + STATE_SIZE
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        packed = self._pack_hysteresis(parameters)
        steepest = packed[1] if self.law == 'plays' else packed[0]
        minimum = 0.1 * abs(steepest) if self._minimum_slope is None else self._minimum_slope
        if not minimum > 0:
            raise CompensationError(f'minimum_slope must be positive, got {minimum:g} m/V')
        k1, k2 = structure_coefficients(parameters)
        lead = 0.5 * self.dt if k2 > 0.0 else 0.0
        if self._lead_given is not None:
            lead = self._lead_given
        lead += parameters.get('delay', 0.0)
        return np.array([minimum, k1, k2, lead, *packed])

    def _pack_hysteresis(self, parameters: Mapping[str, float]) -> list[float]:
        what = f'the inverse {self.law!r}'
        if self.law == 'plays':
            packed = take(parameters, PLAYS, what)
            if not monotonic_plays(np.array(packed)):
                raise CompensationError(
                    'the Prandtl-Ishlinskii model has no inverse: pi_range must be positive, and '
                    'w0 and the sum of all weights must have one sign; identify again'
                )
            return packed
        if self.law == 'gain':
            packed = take(parameters, ('A1',), what)
            packed += [0.0] * 4
        else:
            packed = take({'A0': 0.0, **parameters}, BOUC_WEN, what)
        # The delayed law only divides by A1.
        check_monotonic(packed if self.law != 'delayed' else [packed[0], 0.0, 0.0])
        return packed

    def _carry_over(self, old: FloatArray, new: FloatArray) -> None:
        keep_sign('w0' if self.law == 'plays' else 'A1', old[FIRST:], new[FIRST:])
        # The states of the plays are voltages, which are unchanged.
        if self.law != 'plays':
            ratio = saturation(new[FIRST:]) / max(saturation(old[FIRST:]), 1e-300)
            self.own[hysteresis.H] *= ratio

    def packing(self, place: Mapping[str, int]) -> Packing:
        """Return how it packs parameters; a mere gain has none that can change."""
        if self.law == 'gain':
            return super().packing(place)
        return _packing(self.law, place, self.dt)

    def counters(self) -> dict[str, int]:
        """Return the error counters; ``corners`` counts steps of the slope of the reference."""
        return {**super().counters(), 'corners': int(self.own[_SIZES[self.law] + CORNERS])}


# How a structure is given.
_MODE, _MASS, _RIGID = range(3)


def _packing(law: str, place: Mapping[str, int], dt: float) -> Packing:
    """Return the packing of `PhysicalInverse`."""
    plays = law == 'plays'
    known = tuple(name for name in (PLAYS if plays else BOUC_WEN) if name in place)
    at = tuple(place.get(name, -1) for name in (PLAYS if plays else BOUC_WEN))
    delay = place.get('delay', -1)
    if 'mass' in place:
        kind, structure = _MASS, tuple(place[n] for n in ('mass', 'damping', 'stiffness'))
    elif 'natural_frequency' in place:
        kind, structure = _MODE, (place['natural_frequency'], place['damping_ratio'], 0)
    else:
        kind, structure = _RIGID, (0, 0, 0)
    count, solved, slope = len(at), law != 'delayed', 1 if plays else 0

    @inline_jit
    def pack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new, k1, k2 = scratch(count), 0.0, 0.0
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if kind == _MODE:
            k1, k2 = mode_coefficients(values[structure[0]], values[structure[1]])
        elif kind == _MASS:
            stiffness = values[structure[2]]
            k1, k2 = values[structure[1]] / stiffness, values[structure[0]] / stiffness
        if not (k1 >= 0.0 and k2 >= 0.0):
            return IMPOSSIBLE
        if plays and not monotonic_plays(new):
            return IMPOSSIBLE
        if not first and new[slope] * p[FIRST + slope] < 0.0:
            return IMPOSSIBLE
        inner, shift = (new[1], new[2]) if solved else (0.0, 0.0)
        if not plays and not monotonic_bouc_wen(new[0], inner, shift):
            return IMPOSSIBLE
        if not (plays or first):
            own[hysteresis.H] *= saturation(new) / max(saturation(p[FIRST:]), 1e-300)
        lead = 0.5 * dt if k2 > 0.0 else 0.0
        p[MINIMUM] = 0.1 * abs(new[slope])
        p[K1], p[K2] = k1, k2
        p[LEAD] = lead + (values[delay] if delay >= 0 else 0.0)
        for k in range(count):
            p[FIRST + k] = new[k]
        return OK

    names = (
        'natural_frequency',
        'damping_ratio',
        'mass',
        'damping',
        'stiffness',
        'delay',
        'offset',
    )
    return Packing(pack, (*known, *(name for name in names if name in place)))


def structure_coefficients(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``w = d + k1 d' + k2 d''`` for the structure of a model."""
    if 'mass' in parameters:
        mass, damping, stiffness = take(
            parameters, ('mass', 'damping', 'stiffness'), 'the structure'
        )
        if not (mass > 0 and stiffness > 0):
            raise CompensationError('mass and stiffness must be positive')
        return damping / stiffness, mass / stiffness
    if parameters.get('natural_frequency', 0.0) == 0.0:
        return 0.0, 0.0
    frequency, ratio = take(parameters, ('natural_frequency', 'damping_ratio'), 'the mode')
    if not frequency > 0:
        raise CompensationError(f'natural_frequency must be positive, got {frequency:g} Hz')
    return mode_coefficients(frequency, ratio)


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


def keep_sign(name: str, old: FloatArray, new: FloatArray) -> None:
    """Refuse parameters that reverse a running inverse; the first gain is named `name`."""
    place = 1 if name == 'w0' else 0
    if old[place] * new[place] < 0.0:
        raise CompensationError(
            f'{name} = {new[place]:g} m/V would reverse the voltage of a running inverse; load '
            'the model anew'
        )


def check_monotonic(bouc_wen: list[float]) -> None:
    """Refuse A1, A, A0, ... of a model whose slope from rest has not the sign of A1."""
    a1, a, a0 = bouc_wen[:3]
    if not monotonic_bouc_wen(a1, a, a0):
        raise CompensationError(
            f'A1 = {a1:g} m/V and the slope from rest, A1 - A -+ A0 = {a1 - a - a0:g} and '
            f'{a1 - a + a0:g} m/V, have not one sign: the model turns back, so it has no '
            'inverse; identify with that bound'
        )


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


_EXTENDED = {'solved': _invert_extended, 'printed': _invert_printed}


def _extended_packing(place: Mapping[str, int]) -> Packing:
    """Return the packing of `ExtendedInverse`."""
    at = tuple(place.get(name, -1) for name in NAMES)
    count = len(NAMES)

    @inline_jit
    def pack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new = scratch(count)
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if new[0] == 0.0 or (not first and new[0] * p[0] < 0.0):
            return IMPOSSIBLE
        if not first:
            own[_H] *= saturation(new) / max(saturation(p), 1e-300)
        for k in range(count):
            p[k] = new[k]
        p[count] = 0.1 * abs(new[0])
        return OK

    return Packing(pack, tuple(name for name in (*NAMES, 'offset') if name in place))


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
        if law not in _EXTENDED:
            raise CompensationError(
                f'there is no inverse {law!r} of the extended model; choose solved or printed'
            )
        self.run = _EXTENDED[law]
        self._minimum_slope = minimum_slope
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def packing(self, place: Mapping[str, int]) -> Packing:
        """Return how it packs parameters."""
        return _extended_packing(place)

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
