"""Feedforward for models made of a hysteresis and a structure: 002 (8) and better."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation import hysteresis_inverse as hysteresis
from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.inverse import InverseLink, take
from piezo_hysteresis.compensation.structure_inverse import (
    CORNERS,
    STATE_SIZE,
    invert_structure,
    mode_coefficients,
)
from piezo_hysteresis.errors import CompensationError

Law = Literal['exact', 'euler', 'delayed', 'gain']
_Kernel = Callable[
    [FloatArray, FloatArray, FloatArray, FloatArray, float, float, float],
    None,
]

_KERNELS: dict[str, _Kernel] = {
    'exact': hysteresis.invert_exact,
    'euler': hysteresis.invert_euler,
    'delayed': hysteresis.invert_delayed,
    'gain': hysteresis.invert_gain,
}
_BOUC_WEN = ('A1', 'A', 'A0', 'beta', 'gamma')


class PhysicalInverse(InverseLink):
    """Feedforward by inverting a Bouc-Wen hysteresis behind a structure, 002 (8).

    The structure (one mode, or none) is inverted on the reference's analytic derivatives in the
    middle of the interval of the hold; the hysteresis sample by sample.

    Parameters
    ----------
    parameters : mapping of str to float
        ``A1, A`` [m/V], ``beta, gamma`` [1/V] and, where they apply, ``A0`` [m/V],
        ``natural_frequency`` [Hz] with ``damping_ratio``, ``delay`` [s], ``offset`` [m]; for the
        law ``gain`` only ``gain`` [m/V] of the first five.
    dt : float
        Sampling interval [s].
    law : {'exact', 'euler', 'delayed', 'gain'}
        ``exact``: of the exact step; ``euler``: of the papers' step by its branch rule;
        ``delayed``: with h of the sample before, Rakotondrabe's multiplicative form and 002 (8)
        as printed; ``gain``: no hysteresis.
    minimum_slope : float, optional
        Smallest slope that is used [m/V]; a tenth of A1 where it is not given.
    lead : float, optional
        Seconds from the tick to the middle of the effect of the voltage [s]; half a sample for a
        model with a mode and 0 for one without where it is not given. The delay comes on top.
    limits, start, transition
        As in `InverseLink`.

    Raises
    ------
    CompensationError
        If a parameter is missing or not finite, or the model falls where the voltage rises.
    """

    counter_names = ('clamped_slopes', 'out_of_stroke')
    memory_size = 4

    def __init__(
        self,
        parameters: Mapping[str, float],
        dt: float,
        *,
        law: Law = 'exact',
        minimum_slope: float | None = None,
        lead: float | None = None,
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if law not in _KERNELS:
            raise CompensationError(
                f'there is no inverse {law!r} of a hysteresis; choose one of {", ".join(_KERNELS)}'
            )
        self._law = law
        self._kernel = _KERNELS[law]
        self._minimum_slope = minimum_slope
        self._lead_given = lead
        super().__init__(parameters, dt, limits=limits, start=start, transition=transition)

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        what = f'the {self._law} inverse'
        if self._law == 'gain':
            packed = [*take(parameters, ('gain',), what), 0.0, 0.0, 0.0, 0.0]
        else:
            packed = take({'A0': 0.0, **parameters}, _BOUC_WEN, what)
        check_rising(packed)
        lead, k1, k2 = 0.0, 0.0, 0.0
        if parameters.get('natural_frequency', 0.0) > 0.0:
            frequency, ratio = take(parameters, ('natural_frequency', 'damping_ratio'), what)
            k1, k2 = mode_coefficients(frequency, ratio)
            lead = 0.5 * self.dt
        if self._lead_given is not None:
            lead = self._lead_given
        minimum = 0.1 * packed[0] if self._minimum_slope is None else self._minimum_slope
        if not minimum > 0:
            raise CompensationError(f'minimum_slope must be positive, got {minimum:g} m/V')
        return np.array([*packed, minimum, k1, k2, lead + parameters.get('delay', 0.0)])

    def _initial_memory(self) -> FloatArray:
        return np.zeros(self.memory_size + STATE_SIZE)

    def _run(self, reference: FloatArray, voltage: FloatArray, memory: FloatArray) -> None:
        p, own = self._packed, self.memory_size
        target = np.empty(voltage.size)
        invert_structure(reference, target, memory[own:], p[6], p[7], p[8], self.dt)
        self._kernel(target, voltage, memory[:own], p, p[5], self._low, self._high)

    def _carry_over(self, old: FloatArray, new: FloatArray) -> None:
        self._memory[hysteresis.H] *= saturation(new) / max(saturation(old), 1e-300)

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far; ``corners`` tell of a reference that is not smooth."""
        return {**super().counters(), 'corners': int(self._memory[self.memory_size + CORNERS])}


def saturation(packed: FloatArray) -> float:
    """Return the level at which h saturates [m]; packed is A1, A, A0, beta, gamma, ..."""
    a, a0, beta, gamma = (float(value) for value in packed[1:5])
    return max(abs(a) + abs(a0), 1e-15) / max(beta + gamma, 1e-3)


def check_rising(bouc_wen: list[float]) -> None:
    """Refuse A1, A, A0, ... of a model that falls where the voltage rises from rest.

    Raises
    ------
    CompensationError
        If A1 or the slope from rest is not positive.
    """
    a1, a, a0 = bouc_wen[:3]
    if not a1 > 0:
        raise CompensationError(
            f'A1 = {a1:g} m/V is not positive, so the model has no inverse; check the polarity '
            'of sensor and amplifier and identify again'
        )
    if not a1 - a - abs(a0) > 0:
        raise CompensationError(
            f'A1 - A - |A0| = {a1 - a - abs(a0):g} m/V is not positive: the model falls where '
            'the voltage rises, so it has no inverse; identify with that bound'
        )


def least_slope(parameters: Mapping[str, float]) -> float:
    """Return the smallest slope dw/du that a Bouc-Wen model can take [m/V].

    It is that just behind a reversal of a saturated h: A1 - A - |A0| - (beta - gamma) h_max. A
    model where it is not positive has no inverse near the tips of its largest loops.

    Parameters
    ----------
    parameters : mapping of str to float
        ``A1, A, beta, gamma`` and, where it is not 0, ``A0``.
    """
    a1, a, a0, beta, gamma = take({'A0': 0.0, **parameters}, _BOUC_WEN, 'the slope')
    highest = (a + abs(a0)) / (beta + gamma) if beta + gamma > 0 else math.inf
    steepest = max(beta - gamma, 0.0)
    return a1 - a - abs(a0) - (steepest * highest if steepest > 0 else 0.0)
