"""Recursive least squares of the papers, Fujii 2018 (8)-(12), Tatebatake 2017 (8)-(11), compiled.

It follows the papers as far as they are consistent, including their behaviour: one-step errors are
small, but free-run errors may be large, because the regressor contains hysteresis sums and the
result depends on the unit of the displacement through P0 = I. `rls_ud` and `output_error` are the
well-posed methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import cos, isfinite, nan, pi, sin, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.recursion import (
    WEIGHT_SUM,
    Estimate,
    Layout,
    OnlineMethod,
    OnlineSettings,
    RecursionState,
)
from piezo_hysteresis.jit import inline_jit, jit
from piezo_hysteresis.models import Model, named

_TRACE_MAX = 1e3  # mean of the diagonal of P above which forgetting is suspended; P0 = I has 1

VARIANTS = ('V0', 'V1', 'V2', 'basic')
BASIC = 3.0  # number of the variant without recursion and A0

#: Models of Fujii 2018 by the harmonic order that they have.
BY_ORDER = {0: 'extended', 3: 'enhanced3', 5: 'enhanced5'}
#: Factors from metres to the working unit.
WORKING_UNITS = {'m': 1.0, 'mm': 1e3, 'um': 1e6, 'nm': 1e9}

_MEMORY = 16  # numbers in the memory
_VARIANT, _OFFSET, _HARMONIC, _OMEGA, _PHASE = range(1, 6)  # in the constants, after FORGETTING


@inline_jit
def _gain(
    x: FloatArray, theta: FloatArray, p: FloatArray, g: FloatArray, error: float, forgetting: float
) -> None:
    """Update theta and P in place by one RLS step, with g as work space."""
    n = theta.size
    s = forgetting
    # P is exactly symmetric, so its rows are used as columns and the inner loop vectorises
    for i in range(n):
        g[i] = p[0, i] * x[0]
    for j in range(1, n):
        for i in range(n):
            g[i] += p[j, i] * x[j]
    for i in range(n):
        s += g[i] * x[i]
    step = error / s
    root = sqrt(1.0 / s)
    for i in range(n):
        theta[i] += g[i] * step
        g[i] *= root
    for i in range(n):
        for j in range(n):
            p[i, j] -= g[i] * g[j]
    if forgetting < 1.0:
        _inflate(p, forgetting)


@inline_jit
def _inflate(p: FloatArray, forgetting: float) -> None:
    """Inflate P up to a bound, because without excitation it would grow indefinitely."""
    n = p.shape[0]
    trace = 0.0
    for i in range(n):
        trace += p[i, i]
    if trace < _TRACE_MAX * n:
        grow = 1.0 / forgetting
        for i in range(n):
            for j in range(n):
                p[i, j] *= grow


@inline_jit
def _lags(
    y: float, y1: float, y2: float, y3: float, z2: float, z3: float, variant: float
) -> tuple[float, float, float]:
    """Return autoregressive columns and target by the number of the variant.

    They are from Fujii 2018 (10), (3) or Tatebatake 2017 (10); the basic model has none, its (18).
    """
    if variant == BASIC:
        return 0.0, 0.0, y
    if variant == 0.0:
        return y1, y2, y
    if variant == 1.0:
        # with a harmonic, V1 regresses on y1 = y - y3, Fujii 2018 (6); y3 is zero otherwise
        return y2 - z2, y3 - z3, y - y1
    return y2, y1, y - y1


@jit
def update_many(
    u: FloatArray,
    y: FloatArray,
    errors: FloatArray,
    theta: FloatArray,
    p: FloatArray,
    rows: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    """Update with samples; `scale` is the number of working units per metre.

    The memory is in local variables during the loop, which is four times faster.
    """
    samples, ee, ww, k0, y1, y2, y3, u1, h, su, sv, sb, sg, z1, z2, z3 = m
    forgetting, variant, offset, harmonic, omega, phase, scale = c
    x, g = rows[0], rows[1]
    samples -= k0
    n = theta.size
    last = n - 4
    # Tatebatake 2017 has +S(du), +S|du| and -A0|du| where Fujii 2018 has the opposite
    sign = 1.0 if variant == 2.0 else -1.0
    for k in range(u.size):
        voltage, value = u[k], y[k] * scale
        if not (isfinite(voltage) and isfinite(value)):
            errors[k] = nan  # a lost sample is skipped: a NaN in P would persist
            continue
        du = voltage - u1
        travel, size = abs(du), abs(h)
        su, sv, sb, sg = su + du, sv + travel, sb + travel * h, sg + size * du
        x[0], x[1], error = _lags(value, y1, y2, y3, z2, z3, variant)
        x[2], x[3], x[4], x[5], x[6] = voltage, sign * su, sign * sv, sb, sg
        if variant == BASIC:  # a column of zeros leaves its parameter at the initial value 0
            x[4] = 0.0
        if offset == 1.0:
            x[7] = 1.0
        if harmonic > 0.0:
            x[last], x[last + 1] = z2, z3
            x[last + 2], x[last + 3] = sin(phase + omega * k0), cos(phase + omega * k0)
        for i in range(n):
            error -= theta[i] * x[i]
        _gain(x, theta, p, g, error, forgetting)
        h += (
            theta[3] * du - sign * theta[4] * travel - theta[6] * size * du - theta[5] * travel * h
        )
        if harmonic > 0.0:
            z = z1
            for i in range(last, n):
                z += theta[i] * x[i]
            z1, z2, z3 = z, z1, z2
        y1, y2, y3, u1, k0 = value, y1, y2, voltage, k0 + 1.0
        ee, ww = forgetting * ee + error * error, forgetting * ww + 1.0
        errors[k] = error / scale
    kept = (samples + k0, ee, ww, k0, y1, y2, y3, u1, h, su, sv, sb, sg, z1, z2, z3)
    for i in range(len(kept)):
        m[i] = kept[i]


@jit
def free_run(u: FloatArray, y: FloatArray, theta: FloatArray, c: FloatArray) -> None:
    """Simulate the model of the variant from rest with fixed parameters."""
    u1 = h = y1 = y2 = y3 = z1 = z2 = z3 = 0.0
    a0 = -theta[4] if c[_VARIANT] == 2.0 else theta[4]
    last = theta.size - 4
    for k in range(u.size):
        du = u[k] - u1
        travel = abs(du)
        h += theta[3] * du + a0 * travel - theta[6] * abs(h) * du - theta[5] * travel * h
        v = theta[2] * u[k] - h
        if c[_OFFSET] == 1.0:
            v += theta[7]
        # y is the recursion without the harmonic (V1, V2: y1 of Fujii 2018 (6)), z the harmonic.
        if c[_VARIANT] == 0.0:
            value = theta[0] * y1 + theta[1] * y2 + v
        elif c[_VARIANT] == BASIC:
            value = v
        else:
            value = y1 + theta[0] * y2 + theta[1] * y3 + v
        y3, y2, y1, u1 = y2, y1, value, u[k]
        y[k] = value
        if c[_HARMONIC] > 0.0:
            phase = c[_PHASE] + c[_OMEGA] * k
            drive = theta[last + 2] * sin(phase) + theta[last + 3] * cos(phase)
            z = z1 + theta[last] * z2 + theta[last + 1] * z3 + drive
            if c[_VARIANT] == 0.0:
                # V0 adds the harmonic inside the recursion of the total y.
                y[k] += theta[last] * z2 + theta[last + 1] * z3 + drive
                y1 = y[k]
            else:
                y[k] += z
            z3, z2, z1 = z2, z1, z


@dataclass(frozen=True)
class RlsSettings(OnlineSettings):
    """Settings of the papers' RLS.

    Attributes
    ----------
    variant : str
        ``V1``: Fujii 2018 (3), target y[k]-y[k-1], columns y[k-2], y[k-3] (default, parameters of
        the model `extended`). ``V0``: Fujii 2018 (10) as printed, a free second-order
        autoregression (model `extended_free`). ``V2``: Tatebatake 2017 (10) as printed. ``basic``:
        Tatebatake 2017 (17), (18), no autoregression and no A0 (model `classical_euler`).
    offset : bool
        Add a constant column; the papers have none and therefore miss the off-centre loop.
    harmonic : int
        0, or 3 or 5 for the exogenous odd harmonic of Fujii 2018 (6), (7).
    frequency : float
        Fundamental frequency of the drive [Hz]; needed with `harmonic`.
    forgetting : float
        Forgetting factor in (0, 1]; the papers give none, so 1.
    unit : str
        Working unit of y: ``mm`` reproduces the papers, because P0 = I has a unit.
    dt : float
        Sampling interval [s].
    p0 : float
        Initial P is this times the identity; the papers have 1.
    start : mapping of str to float
        Initial values in SI units, by the names of the estimate; others are as in the papers.
    """

    variant: str = 'V1'
    offset: bool = False
    harmonic: int = 0
    frequency: float = 0.0
    unit: str = 'mm'
    p0: float = 1.0
    start: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_positive('p0')
        if self.variant not in VARIANTS:
            raise IdentificationError(
                f'variant {self.variant!r} is unknown{choices(self.variant, VARIANTS)}'
            )
        if self.harmonic not in BY_ORDER:
            raise IdentificationError(f'harmonic must be 0, 3 or 5, got {self.harmonic}')
        if self.harmonic and self.variant in ('V2', 'basic'):
            raise IdentificationError(
                f'{self.variant} (Tatebatake 2017) has no harmonic; choose V0 or V1 for it'
            )
        if self.harmonic and not (0 < self.harmonic * self.frequency * self.dt < 0.5):
            raise IdentificationError(
                f'harmonic {self.harmonic} of {self.frequency:g} Hz cannot be seen at '
                f'{1 / self.dt:g} samples/s; give the frequency of the drive'
            )
        if self.unit not in WORKING_UNITS:
            raise IdentificationError(
                f'unit {self.unit!r} is unknown{choices(self.unit, WORKING_UNITS)}'
            )


class OnlineRls(OnlineMethod):
    """Recursive least squares of the papers, Fujii 2018 (8)-(12), Tatebatake 2017 (8)-(11).

    The default initial values are those of the papers: P0 = I, all parameters 0 except
    A1 = .01, A = .005, beta = gamma = .001 in the working unit per volt; h = 0 and y = 0 before
    the first sample.

    Parameters
    ----------
    settings : RlsSettings
        Variant, columns, unit and forgetting.
    """

    Settings = RlsSettings
    _kernel = staticmethod(update_many)

    def _initial(self) -> RecursionState:
        s = self._settings
        n = 7 + s.offset + 4 * (s.harmonic > 0)
        omega = 2 * pi * s.harmonic * s.frequency * s.dt
        variant, scale = VARIANTS.index(s.variant), WORKING_UNITS[s.unit]
        return RecursionState(
            theta=self._start(n),
            covariance=s.p0 * np.eye(n),
            rows=np.zeros((2, n)),
            memory=np.zeros(_MEMORY),
            constants=np.array(
                [s.forgetting, variant, s.offset, s.harmonic, omega, 0.0, scale], dtype=float
            ),
        )

    def _start(self, n: int) -> FloatArray:
        theta = np.zeros(n)
        theta[[2, 3, 5, 6]] = 0.01, 0.005, 0.001, 0.001
        # no offset before the autoregression is known
        known = {name: (place, f) for name, _, f, place in self._layout() if name != 'offset'}
        for name, value in self._settings.start.items():
            if name not in known or not isfinite(value):
                raise IdentificationError(
                    f'rls cannot start from {name} = {value:g}; it starts from finite '
                    f'{", ".join(known)}'
                )
            place, to_metres = known[name]
            theta[place] = value / to_metres
        return theta

    def drive_at(self, frequency: float, start: float = 0.0) -> None:
        """Set another drive, from rest; no effect without a harmonic.

        Parameters
        ----------
        frequency : float
            Frequency of the drive [Hz].
        start : float
            Time of the next sample since the drive had phase 0 [s].

        Raises
        ------
        IdentificationError
            If its harmonic is above half the sampling rate.
        """
        s = self._settings
        if s.harmonic:
            self._settings = replace(s, frequency=frequency)  # checks it
            constants = self._state.constants
            constants[_OMEGA] = 2 * pi * s.harmonic * frequency * s.dt
            constants[_PHASE] = 2 * pi * s.harmonic * (frequency * start % 1.0)

    def rest(self) -> None:
        """Start a new record from rest and keep the estimate."""
        self._state.memory[WEIGHT_SUM + 1 :] = 0.0

    def free_run(self, voltage: FloatArray) -> FloatArray:
        """Simulate the estimate from rest for `voltage` [V]; return the displacement [m]."""
        u = np.ascontiguousarray(voltage, dtype=np.float64)
        y = np.empty_like(u)
        free_run(u, y, self._state.theta, self._state.constants)
        y /= WORKING_UNITS[self._settings.unit]
        return y

    def estimate(self) -> Estimate:
        """Return the current estimate of the parameters in SI units."""
        rms = self._sigma / WORKING_UNITS[self._settings.unit]
        found = self._estimate(self._layout(), self._state.theta, self._state.covariance, rms)
        # P0 along A1 + A is not a deviation: that sum keeps its initial value, see the notes.
        found.standard_deviations[[found.names.index('A1'), found.names.index('A')]] = np.inf
        if self._settings.offset:
            self._place_offset(found.values, found.standard_deviations)
        return replace(found, notes=self._notes(), model=self._model_name())

    def model(self) -> Model | None:
        """Return the named model of the estimate, None for V0 with a harmonic."""
        return named(self._model_name()) if self._model_name() else None

    def _layout(self) -> Layout:
        s, metre = self._settings, 1 / WORKING_UNITS[self._settings.unit]
        lags = ('a1', 'a2') if s.variant == 'V0' else ('c1', 'c2')
        # Tatebatake 2017 writes -A0|du| where Fujii 2018 has +A0|du|.
        by_travel = -metre if s.variant == 'V2' else metre
        rows = [('A1', 'm/V', metre, 2), ('A', 'm/V', metre, 3), ('A0', 'm/V', by_travel, 4)]
        rows += [('beta', '1/V', 1.0, 5), ('gamma', '1/V', 1.0, 6)]
        rows += [(name, '1', 1.0, place) for place, name in enumerate(lags)]
        if s.variant == 'basic':
            rows = [row for row in rows if row[0] not in ('A0', *lags)]
        if s.offset:
            rows.append(('offset', 'm', metre, 7))
        if s.harmonic:
            last = 7 + s.offset
            lags = ('c5', 'c6') if s.harmonic == 5 else ('c3', 'c4')
            drive = ('al3', 'al4') if s.harmonic == 5 else ('al1', 'al2')
            rows += [(name, '1', 1.0, last + k) for k, name in enumerate(lags)]
            rows += [(name, 'm', metre, last + 2 + k) for k, name in enumerate(drive)]
        return rows

    def _place_offset(self, values: FloatArray, spread: FloatArray) -> None:
        """Convert the constant column to the output offset of the named model."""
        if self._settings.variant == 'basic':
            return
        lag = 1.0 if self._settings.variant == 'V0' else 0.0
        steady = lag - values[5] - values[6]
        values[7] = values[7] / steady if steady != 0 else 0.0
        spread[7] = spread[7] / abs(steady) if steady != 0 else float('inf')

    def _model_name(self) -> str:
        if self._settings.variant == 'basic':
            return 'classical_euler'
        if self._settings.variant == 'V0':
            return '' if self._settings.harmonic else 'extended_free'
        return BY_ORDER[self._settings.harmonic]

    def _notes(self) -> tuple[str, ...]:
        notes = [
            (
                'RLS identifies only A1 - A; A1 + A stays at its initial value. Use '
                'output_error for both.'
            )
        ]
        if self._settings.offset and self._settings.variant != 'basic':
            notes.append('A0 and the offset cannot be distinguished in steady state.')
        if self._settings.harmonic:
            notes.append(
                'One sine excites two of the four harmonic columns: their split is that of least '
                'norm, not physics.'
            )
        if self._settings.variant == 'V0' and self._settings.harmonic:
            notes.append('V0 takes the harmonic into its recursion: no named model has its form.')
        return tuple(notes)
