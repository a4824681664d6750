"""Well-posed recursions: Bierman's UD filter and its two regressors, compiled.

The papers' RLS (`rls`) regresses on measured displacements. These methods predict by simulation:
their one-step error is the free-run error, including the offset. The mode is fixed (from
`output_error`) or omitted if the drive is far below it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, nan, pi
from typing import ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import exact_step
from piezo_hysteresis.blocks._plays import COUNT, play
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.recursion import (
    ERROR_SUM,
    FORGETTING,
    SAMPLES,
    WEIGHT_SUM,
    Estimate,
    Layout,
    OnlineMethod,
    OnlineSettings,
    RecursionState,
)
from piezo_hysteresis.jit import inline_jit, jit
from piezo_hysteresis.kernels.forward import jacobian
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.named import BANK

# Indices in the memory and in the constants, after those that all kernels share.
LAST, H, H_BETA, H_GAMMA, H_MAX, TRAVEL, ACTIVITY, PROJECTED, PLAYS = range(3, 12)
KIND, WITH_MODE, A11, A12, A21, A22, QUIET, SMOOTH, VOLTAGE, DISPLACEMENT = range(1, 11)
BOUC_WEN, PLAY_BANK = 0.0, 1.0

# Rows of the state: work space of the update and its gain, filtered columns, columns before the
# mode, the diagonal d with its limit, state of the mode for each column.
INNER, GAIN, FILTERED, COLUMNS, D, D_MAX, MODE_STATE, ROWS = 0, 1, 2, 3, 4, 5, 6, 8

MARGIN = 0.05  # smallest slope of the model after a reversal, over its gain
_BOX = 50.0  # bound of gain and shape in units of the ranges
_STEP = 0.02  # largest relative change of the shape in one update
_SHORTEST = 16.0  # shortest memory with forgetting [ranges travelled]: four full cycles
_FIRST, _GROWTH = 8.0, 0.25  # memory at the start [ranges travelled], and its growth
_SETTLED = 4.0  # travel in ranges, one full cycle, before the shape is estimated

_step = jacobian(exact_step)


@inline_jit
def bierman(u: FloatArray, rows: FloatArray, forgetting: float) -> float:
    """Update P = U diag(d) U' for the filtered columns; return the divisor of the gain.

    The noise of one sample has variance one. Square roots and differences of P are avoided, so P
    stays positive definite whatever the rounding (Bierman 1977).
    """
    f, b, x, d = rows[INNER], rows[GAIN], rows[FILTERED], rows[D]
    n = x.size
    for i in range(n):
        total = x[i]
        for j in range(i):
            total += u[j, i] * x[j]
        f[i] = total
    a: float = forgetting
    for j in range(n):
        g = d[j] * f[j]
        before = a
        a += f[j] * g
        d[j] *= before / a
        b[j] = g
        share = -f[j] / before
        for i in range(j):
            old = u[i, j]
            u[i, j] = old + b[i] * share
            b[i] += old * g
    return a


@inline_jit
def _bouc_wen_columns(u: float, theta: FloatArray, m: FloatArray, v: FloatArray) -> None:
    """Fill v with u, -h and the derivatives by beta and gamma, for h of unit A."""
    du = u - m[LAST]
    if du != 0.0:
        h, by_h, _, _, _, by_beta, by_gamma = _step(m[H], du, 1.0, 0.0, theta[2], theta[3])
        m[H] = h
        m[H_BETA] = by_h * m[H_BETA] + by_beta
        m[H_GAMMA] = by_h * m[H_GAMMA] + by_gamma
        m[H_MAX] = max(m[H_MAX], abs(h))
    v[0] = u
    v[1] = -m[H]
    v[2] = -theta[1] * m[H_BETA]
    v[3] = -theta[1] * m[H_GAMMA]


@inline_jit
def _play_columns(u: float, m: FloatArray, v: FloatArray) -> None:
    """Fill v with u and the plays at a tenth of the range, two tenths, ..."""
    v[0] = u
    for j in range(1, v.size):
        place = PLAYS + j - 1
        m[place] = play(u, m[place], 0.1 * j)
        v[j] = m[place]


@inline_jit
def _through_mode(x: FloatArray, v: FloatArray, q: FloatArray, c: FloatArray) -> None:
    """Filter each column by the fixed mode, sampled before the new hold acts."""
    if c[WITH_MODE] == 0.0:
        for i in range(v.size):
            x[i] = v[i]
        return
    for i in range(v.size):
        x[i] = q[0, i]
        moved = c[A11] * q[0, i] + c[A12] * q[1, i] + (1.0 - c[A11]) * v[i]
        q[1, i] = c[A21] * q[0, i] + c[A22] * q[1, i] - c[A21] * v[i]
        q[0, i] = moved


@inline_jit
def _project_bouc_wen(theta: FloatArray, m: FloatArray) -> None:
    """Project onto a decaying h (beta > |gamma|) and a positive slope after reversals."""
    theta[0] = min(max(theta[0], -_BOX), _BOX)
    theta[2] = min(max(theta[2], 1.0 / _BOX), _BOX)
    theta[3] = min(max(theta[3], -0.95 * theta[2]), 0.95 * theta[2])
    steepest = 1.0 + (theta[2] - theta[3]) * m[H_MAX]
    most = (1.0 - MARGIN) * theta[0] / steepest
    low, high = min(0.0, most), max(0.0, most)
    if theta[1] < low or theta[1] > high:
        theta[1] = min(max(theta[1], low), high)
        m[PROJECTED] += 1.0


@inline_jit
def update(
    u: float,
    y: float,
    theta: FloatArray,
    factor: FloatArray,
    rows: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> float:
    """Update with one sample in units of the ranges; return the prediction error."""
    if not isfinite(u):
        u = m[LAST]
    n = theta.size
    x, v = rows[FILTERED], rows[COLUMNS, : n - 1]
    moved = abs(u - m[LAST])
    if c[KIND] == BOUC_WEN:
        _bouc_wen_columns(u, theta, m, v)
    else:
        _play_columns(u, m, v)
    _through_mode(x, v, rows[MODE_STATE:], c)
    x[n - 1] = 1.0
    m[LAST] = u
    m[SAMPLES] += 1.0
    m[TRAVEL] += moved
    m[ACTIVITY] += c[SMOOTH] * (moved - m[ACTIVITY])
    error: float = y - theta[n - 1]
    linear = 2 if c[KIND] == BOUC_WEN else n - 1
    for i in range(linear):
        error -= theta[i] * x[i]
    if not isfinite(error):
        return nan
    m[ERROR_SUM] = c[FORGETTING] * m[ERROR_SUM] + error * error
    m[WEIGHT_SUM] = c[FORGETTING] * m[WEIGHT_SUM] + 1.0
    if m[ACTIVITY] < c[QUIET]:
        return error  # an actuator at rest shows only its noise
    if c[KIND] == BOUC_WEN and m[TRAVEL] < _SETTLED:
        x[2] = x[3] = 0.0
    _learn(error, theta, factor, rows, m, c)
    return error


@inline_jit
def _learn(
    error: float,
    theta: FloatArray,
    factor: FloatArray,
    rows: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    gain, d, d_max = rows[GAIN], rows[D], rows[D_MAX]
    # a loop is determined by a few cycles, so the memory is never shorter
    speed = min(m[ACTIVITY], 1.0)
    forgetting = max(c[FORGETTING], 1.0 - speed / _SHORTEST)
    if c[KIND] == BOUC_WEN:
        # samples before the shape has converged are discounted faster (Ljung)
        forgetting *= 1.0 - speed / (_FIRST + _GROWTH * m[TRAVEL])
    divisor = bierman(factor, rows, forgetting)
    step = error / divisor
    if c[KIND] == BOUC_WEN:
        # the shape enters nonlinearly: the step is limited to the range of the linearisation
        most = _STEP * theta[2]
        for i in range(2, 4):
            if abs(gain[i] * step) > most:
                step *= most / abs(gain[i] * step)
    for i in range(theta.size):
        theta[i] += gain[i] * step
        d[i] = min(d[i] / forgetting, d_max[i])
    if c[KIND] == BOUC_WEN:
        _project_bouc_wen(theta, m)


@jit
def update_many(
    u: FloatArray,
    y: FloatArray,
    errors: FloatArray,
    theta: FloatArray,
    factor: FloatArray,
    rows: FloatArray,
    m: FloatArray,
    c: FloatArray,
) -> None:
    """Update with samples in volts and metres."""
    for k in range(u.size):
        voltage, displacement = u[k] / c[VOLTAGE], y[k] / c[DISPLACEMENT]
        errors[k] = update(voltage, displacement, theta, factor, rows, m, c) * c[DISPLACEMENT]


_TRUST = 1e6  # initial variance of a parameter over that of the noise, in units of the ranges
_PLAY_TRUST = 1e2  # the same for the weight of a play: only the sum of similar plays is observable
_WINDOW = 0.1  # time over which the motion of the voltage is measured [s]


@dataclass(frozen=True)
class UdSettings(OnlineSettings):
    """Settings of a well-posed recursion.

    Attributes
    ----------
    voltage_range : float
        Largest absolute voltage [V].
    displacement_range : float
        Corresponding displacement, to an order of magnitude [m].
    natural_frequency, damping_ratio : float
        The fixed mode [Hz], [1]; a frequency of 0 omits it.
    forgetting : float
        Forgetting factor in (0, 1]; for slow voltages it is increased, so that the memory always
        covers four full cycles.
    quiet : float
        Speed of the voltage below which the estimate is not updated, in ranges per second.
    dt : float
        Sampling interval [s].
    """

    forgetting: float = 0.9999
    voltage_range: float = 1.0
    displacement_range: float = 1e-4
    natural_frequency: float = 0.0
    damping_ratio: float = 0.02
    quiet: float = 1e-2

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_positive('voltage_range', 'displacement_range', 'damping_ratio')
        if not 0.0 <= self.natural_frequency < 0.5 / self.dt:
            raise IdentificationError(
                f'a mode of {self.natural_frequency:g} Hz cannot be seen at {1 / self.dt:g} '
                'samples/s; give 0 to leave it out'
            )


class OnlineUd(OnlineMethod):
    """Recursive estimator of A1, A, beta, gamma and the offset, bounded without excitation.

    The estimate is held while the actuator is at rest (excitation test), the covariance never
    exceeds its initial value, and every estimate is a model with a bounded, invertible hysteresis.

    Parameters
    ----------
    settings : UdSettings
        Ranges, mode and forgetting.
    """

    Settings = UdSettings
    predicts_freely = True
    _kernel = staticmethod(update_many)
    _kind: ClassVar[float] = BOUC_WEN
    # a linear gain with a small hysteresis
    _start: ClassVar[tuple[float, ...]] = (1.0, 0.3, 1.0, 0.0, 0.0)
    _trust: ClassVar[tuple[float, ...]] = (_TRUST,) * 5

    def _initial(self) -> RecursionState:
        s, n = self._settings, len(self._start)
        transition = (0.0,) * 4
        if s.natural_frequency > 0:
            transition = hold(2 * pi * s.natural_frequency, s.damping_ratio, s.dt)
        constants = (
            s.forgetting, self._kind, float(s.natural_frequency > 0), *transition, s.quiet * s.dt,
            min(s.dt / _WINDOW, 1.0), s.voltage_range, s.displacement_range,
        )  # fmt: skip
        rows = np.zeros((ROWS, n))
        rows[D] = rows[D_MAX] = self._trust
        return RecursionState(
            np.array(self._start), np.eye(n), rows, np.zeros(PLAYS + COUNT), np.array(constants)
        )

    def rest(self) -> None:
        """Start a new record from rest and keep the estimate."""
        self._state.rows[MODE_STATE:] = 0.0
        self._state.memory[[LAST, H, H_BETA, H_GAMMA]] = 0.0
        self._state.memory[PLAYS:] = 0.0

    def model(self) -> Model:
        """Return the chain with the parameters of `estimate`."""
        return named('bouc_wen_mode' if self._settings.natural_frequency > 0 else 'classical')

    def free_run(self, voltage: FloatArray) -> FloatArray:
        """Simulate the estimate from rest for `voltage` [V]; return the displacement [m]."""
        model = self.model()
        return model.respond(
            np.ascontiguousarray(voltage, dtype=np.float64),
            model.pack(self.estimate().parameters()),
            self._settings.dt,
        )

    def estimate(self) -> Estimate:
        """Return the current estimate of the parameters in SI units."""
        s, state = self._settings, self._state
        covariance = (state.covariance * state.rows[D]) @ state.covariance.T
        rms = self._sigma * s.displacement_range
        found = self._estimate(self._layout(), self._usable(), covariance, rms)
        names, units, values = found.names, found.units, found.values
        spread, correlation = found.standard_deviations, found.correlation
        if s.natural_frequency > 0:
            names += ('natural_frequency', 'damping_ratio')
            units += ('Hz', '1')
            values = np.append(values, [s.natural_frequency, s.damping_ratio])
            spread = np.append(spread, [0.0, 0.0])
            correlation = np.pad(correlation, (0, 2))
        chain = self.model()
        # A small input leaves estimates outside the range of models; their deviation shows it.
        bounds = {q.name: (q.low, q.high) for q in chain.parameters}
        anything = (-np.inf, np.inf)
        clipped = [
            np.clip(v, *bounds.get(n, anything)) for n, v in zip(names, values, strict=True)
        ]
        return replace(
            found, names=names, units=units, values=np.array(clipped), standard_deviations=spread,
            correlation=correlation, notes=self._notes(),
            model=chain.name if chain.name != f'{BANK}_mode' else '',
        )  # fmt: skip

    def _usable(self) -> FloatArray:
        """Return the parameters of the nearest model that can be inverted."""
        return self._state.theta

    def _layout(self) -> Layout:
        s = self._settings
        gain, shape = s.displacement_range / s.voltage_range, 1 / s.voltage_range
        # for a negative A, h decays with the opposite sign of gamma
        turned = -shape if self._state.theta[1] < 0 else shape
        return (
            ('A1', 'm/V', gain, 0),
            ('A', 'm/V', gain, 1),
            ('beta', '1/V', shape, 2),
            ('gamma', '1/V', turned, 3),
            ('offset', 'm', s.displacement_range, 4),
        )

    def _notes(self) -> tuple[str, ...]:
        m, notes = self._state.memory, []
        if m[SAMPLES] and m[ACTIVITY] < self._state.constants[QUIET]:
            notes.append('The voltage rests: the estimate is held.')
        if m[SAMPLES] and m[TRAVEL] < 4:
            notes.append('Less than one full cycle seen: the shape of the loop is not learnt yet.')
        return (*notes, *self._changes())

    def _changes(self) -> tuple[str, ...]:
        count = int(self._state.memory[PROJECTED])
        if not count:
            return ()
        return (f'{counted(count, "update", "was")} projected to an invertible model.',)


class OnlineBank(OnlineUd):
    """The same for the weights of ten plays and the offset: linear, with a unique solution.

    Parameters
    ----------
    settings : UdSettings
        Ranges, mode and forgetting.
    """

    _kind = PLAY_BANK
    _start = (1.0, *(0.0,) * (COUNT + 1))
    _trust = (_TRUST, *(_PLAY_TRUST,) * COUNT, _TRUST)

    def model(self) -> Model:
        """Return the chain with the parameters of `estimate`."""
        model = named(BANK)
        if self._settings.natural_frequency > 0:
            model = model.with_block(MODE, f'{BANK}_mode')
        return model.hold(pi_range=self._settings.voltage_range)

    def _usable(self) -> FloatArray:
        return invertible_bank(self._state.theta)

    def _layout(self) -> Layout:
        metre = self._settings.displacement_range
        gain = metre / self._settings.voltage_range
        weights = ((f'w{j}', 'm/V', gain, j) for j in range(COUNT + 1))
        return (*weights, ('offset', 'm', metre, COUNT + 1))

    def _changes(self) -> tuple[str, ...]:
        if np.array_equal(self._usable(), self._state.theta):
            return ()
        return ('Weights were changed to the nearest model that can be inverted.',)


def invertible_bank(theta: FloatArray) -> FloatArray:
    """Return weights and offset, shape (p,), so that each slope has the sign of the total gain.

    The slope after a reversal is the sum of the first weights. If it is less than a twentieth of
    the gain, the weight that lowers it is raised.
    """
    weights = theta[:-1]
    gain = float(weights.sum())
    slopes = np.cumsum(weights)
    least = np.maximum(np.sign(gain) * slopes, MARGIN * abs(gain)) * np.sign(gain)
    return np.append(np.diff(least, prepend=0.0), theta[-1])
