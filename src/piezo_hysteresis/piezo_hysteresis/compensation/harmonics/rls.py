"""Fujii 2018 (18)-(23): the error's harmonic is found by recursive least squares."""

from __future__ import annotations

import cmath
import math

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import Harmonic
from piezo_hysteresis.compensation.harmonics.settings import AttenuationSettings
from piezo_hysteresis.compensation.linear_gain import LinearGain
from piezo_hysteresis.jit import jit

# Above this trace per parameter the covariance is scaled down: forgetting without excitation
# would let it grow for ever.
_LARGEST_COVARIANCE = 1e6


@jit
def rls_update(
    theta: FloatArray,
    covariance: FloatArray,
    regressor: FloatArray,
    error: float,
    forgetting: float,
    work: FloatArray,
) -> None:
    """Take one equation by RLS; `error` is what the regressor does not explain so far."""
    m = theta.size
    power = forgetting
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += covariance[i, j] * regressor[j]
        work[i] = total
        power += regressor[i] * total
    trace = 0.0
    for i in range(m):
        theta[i] += work[i] / power * error
        for j in range(i + 1):
            value = (covariance[i, j] - work[i] * work[j] / power) / forgetting
            covariance[i, j] = value
            covariance[j, i] = value
        trace += covariance[i, i]
    if trace > _LARGEST_COVARIANCE * m:
        scale = _LARGEST_COVARIANCE * m / trace
        for i in range(m):
            for j in range(m):
                covariance[i, j] *= scale


class HarmonicRls:
    """Fujii 2018 (18)-(21) with the printed sign rule, the computed factor, or neither.

    The error e (y - d, or d - y by the printed rule), in V by ``settings.gain``, is fitted as
    Fujii 2018's third equation of (6): ``e[k] - e[k-1] = c3 e[k-2] + c4 e[k-3] + alpha . u3[k]``;
    the correction is ``alpha . u3``. For steady errors this is proportional feedback of the
    harmonic with the factor ``kappa = 1 - z^-1 - c3 z^-2 - c4 z^-3``; with G the plant gain it
    attenuates by ``1 / |1 + s kappa G|`` and is stable where ``|arg(s kappa G)|`` is below 90
    degrees. The computed rule turns the correction so that this angle is 0 at every order.

    Parameters
    ----------
    settings : AttenuationSettings
        Method ``rls``.
    gain : callable
        Modelled plant gain [m/V] by frequency [Hz]; used by the computed rule.
    dt : float
        Sampling interval [s].
    """

    def __init__(self, settings: AttenuationSettings, gain: LinearGain, dt: float) -> None:
        self._settings = settings
        self._gain = gain
        self._dt = dt
        self._orders = np.array(settings.orders, dtype=np.float64)
        self._recursive = 2 if settings.fit == 'recursion' else 0
        self.reset()

    def update(self, error: float, frequency: float, phase: float) -> None:
        """Take the error y - d [m] at `frequency` [Hz] and accumulated `phase` [rad]."""
        if frequency <= 0.0:
            return
        self._frequency = frequency
        value = error * self._settings.gain
        x, past, first = self._regressor, self._past, self._recursive
        if first:
            x[0], x[1] = past[1], past[2]
        angles = self._orders * phase
        x[first::2], x[first + 1 :: 2] = np.sin(angles), np.cos(angles)
        target = value - past[0] if first else value
        missed = target - float(self._theta @ x)
        rls_update(self._theta, self._covariance, x, missed, self._settings.forgetting, self._work)
        past[0], past[1], past[2] = value, past[0], past[1]

    def voltage(self, frequency: float, phase: float) -> float:
        """Answer what to subtract from the voltage [V] at `phase` [rad]."""
        if frequency <= 0.0:
            return 0.0
        return sum(
            (self._correction(i, frequency) * cmath.exp(1j * order * phase)).real
            for i, order in enumerate(self._orders)
        )

    def harmonics(self) -> list[Harmonic]:
        """Return error and correction of every order."""
        rows = []
        for i, order in enumerate(self._orders):
            kappa = self._kappa(order * self._frequency)
            error = self._alpha(i) / kappa / self._settings.gain if kappa else 0j
            theta = self._correction(i, self._frequency)
            rows.append(
                Harmonic(
                    int(order), abs(error), cmath.phase(error), abs(theta), cmath.phase(theta)
                )
            )
        return rows

    def counters(self) -> dict[str, int]:
        """Return how often a correction was held at its bound."""
        return dict(self._counts)

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain."""
        self._gain = gain

    def disturb(self) -> None:
        """Go on: the recursion forgets a transient by itself."""

    def reset(self) -> None:
        """Forget every correction; the covariance is the identity, as in Fujii 2018."""
        size = self._recursive + 2 * self._orders.size
        self._theta: FloatArray = np.zeros(size)
        self._covariance: FloatArray = np.eye(size)
        self._regressor: FloatArray = np.zeros(size)
        self._work: FloatArray = np.zeros(size)
        self._past = [0.0, 0.0, 0.0]
        self._frequency = 0.0
        self._counts = {'bounded': 0}

    def _alpha(self, i: int) -> complex:
        """Return alpha of order i as a phasor [V]: sin goes with -j in Re(. exp(j n phi))."""
        first = self._recursive + 2 * i
        return complex(self._theta[first + 1], -self._theta[first])

    def _kappa(self, frequency: float) -> complex:
        if not self._recursive:
            return 1.0 + 0j
        z = cmath.exp(-2j * math.pi * frequency * self._dt)
        return 1.0 - z - float(self._theta[0]) * z**2 - float(self._theta[1]) * z**3

    def _correction(self, i: int, frequency: float) -> complex:
        settings = self._settings
        line = float(self._orders[i]) * frequency
        theta = self._alpha(i)
        if settings.sign_rule == 'printed' and line <= settings.switch_frequency:
            theta = -theta
        elif settings.sign_rule == 'computed':
            loop = self._kappa(line) * self._gain(line)
            if loop:
                theta *= loop.conjugate() / abs(loop)
        if abs(theta) > settings.largest_correction:
            theta *= settings.largest_correction / abs(theta)
            self._counts['bounded'] += 1
        return theta
