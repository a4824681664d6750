"""Harmonic cancellation by recursive least squares on the filtered reference (FxRLS)."""

from __future__ import annotations

import cmath

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.compensation.harmonics.lines import Harmonic, folded
from piezo_hysteresis.compensation.harmonics.rls import rls_update
from piezo_hysteresis.compensation.harmonics.settings import AttenuationSettings
from piezo_hysteresis.compensation.linear_gain import LinearGain


class FilteredReferenceRls:
    """Sines whose complex amplitude follows the error through the modelled plant gain.

    The fastest and deepest of the methods where the model is right; it has no way to find out
    that the phase of the gain is wrong by more than 90 degrees and then diverges up to its bound.

    Parameters
    ----------
    settings : AttenuationSettings
        Method ``filtered_rls``; a forgetting factor near 0.998 at 1 kHz.
    gain : callable
        Modelled plant gain [m/V] by frequency [Hz].
    dt : float
        Sampling interval [s].
    """

    def __init__(self, settings: AttenuationSettings, gain: LinearGain, dt: float) -> None:
        self._settings = settings
        self._gain = gain
        self._dt = dt
        self._orders = np.array(settings.orders, dtype=np.float64)
        # The level at which the covariance settles for unit sines.
        self._level = 2.0 * (1.0 - settings.forgetting) or 1e-3
        self.reset()

    def disturb(self) -> None:
        """Go on: the recursion forgets a transient by itself."""

    def reset(self) -> None:
        """Forget every correction."""
        count = self._orders.size
        self._share: FloatArray = np.zeros(2 * count)
        self._covariance: FloatArray = self._level * np.eye(2 * count)
        self._work: FloatArray = np.zeros(2 * count)
        self._regressor: FloatArray = np.zeros(2 * count)
        self._theta: ComplexArray = np.zeros(count, dtype=np.complex128)
        self._plant: ComplexArray = np.ones(count, dtype=np.complex128)
        self._error: ComplexArray = np.zeros(count, dtype=np.complex128)
        self._frequency = 0.0
        self._bounded = 0

    def update(self, error: float, frequency: float, phase: float) -> None:
        """Take the error y - d [m] at `frequency` [Hz] and accumulated `phase` [rad]."""
        if frequency <= 0.0:
            return
        if frequency != self._frequency:
            self._frequency = frequency
            self._look_up_gains()
        turns = np.exp(1j * self._orders * phase)
        filtered = turns * self._plant / np.abs(self._plant)
        x = self._regressor
        x[0::2], x[1::2] = filtered.real, -filtered.imag
        before = self._share.copy()
        rls_update(self._share, self._covariance, x, error, self._settings.forgetting, self._work)
        moved = (self._share - before)[0::2] + 1j * (self._share - before)[1::2]
        self._theta += moved / np.abs(self._plant)
        # Slow demodulation, for the report only.
        self._error += 5.0 * self._dt * (2.0 * error * turns.conj() - self._error)
        self._bound()

    def _look_up_gains(self) -> None:
        lines = (float(order) * self._frequency for order in self._orders)
        self._plant = np.array([self._gain(folded(line, self._dt)) for line in lines])

    def _bound(self) -> None:
        size = np.abs(self._theta)
        over = size > self._settings.largest_correction
        if over.any():
            self._theta[over] *= self._settings.largest_correction / size[over]
            self._bounded += 1

    def voltage(self, frequency: float, phase: float) -> float:
        """Answer what to subtract from the voltage [V] at `phase` [rad]."""
        if frequency <= 0.0:
            return 0.0
        return float(np.sum((self._theta * np.exp(1j * self._orders * phase)).real))

    def harmonics(self) -> list[Harmonic]:
        """Return error and correction of every order."""
        return [
            Harmonic(int(n), abs(e), cmath.phase(e), abs(t), cmath.phase(t))
            for n, e, t in zip(self._orders, self._error, self._theta, strict=True)
        ]

    def counters(self) -> dict[str, int]:
        """Return how often a correction was held at its bound."""
        return {'bounded': self._bounded}

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain."""
        self._gain = gain
        if self._frequency > 0.0:
            self._look_up_gains()
