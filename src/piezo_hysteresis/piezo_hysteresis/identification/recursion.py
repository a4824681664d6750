"""What every recursive estimator shares: samples in, errors out, a forgetting factor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.estimate import Estimate


class OnlineMethod(ABC):
    """A recursive estimator that takes samples as they come.

    A subclass sets the places of what all have in the memory `_m` and in the kernel's settings
    `_c`, and its kernel.

    Parameters
    ----------
    settings : RlsSettings or UdSettings
        How it is to run.
    """

    #: Place of the forgetting factor in `_c`, and of the discounted sums of squared errors and of
    #: their weights in `_m`.
    _FORGETTING: ClassVar[int]
    _ERROR_SUM: ClassVar[int]
    _WEIGHT_SUM: ClassVar[int]

    def __init__(self, settings: Any) -> None:
        self._settings = settings
        self._one = np.zeros((3, 1))
        self._c, self._m = np.zeros(0), np.zeros(0)
        self.reset()

    @property
    def forgetting(self) -> float:
        """Forgetting factor; may be set while running."""
        return float(self._settings.forgetting)

    @forgetting.setter
    def forgetting(self, value: float) -> None:
        self._settings = replace(self._settings, forgetting=value)
        self._c[self._FORGETTING] = value

    def update(self, voltage: float, displacement: float) -> float:
        """Take one sample in: voltage [V], displacement [m]; return the prediction error [m].

        A sample whose displacement is not finite is skipped; its error is NaN.
        """
        u, y, error = self._one
        u[0], y[0] = voltage, displacement
        self._take(u, y, error)
        return float(error[0])

    def update_many(self, voltage: FloatArray, displacement: FloatArray) -> FloatArray:
        """Take samples in, shapes (n,); return the prediction errors [m], the bits of `update`.

        Raises
        ------
        IdentificationError
            If the two arrays differ in length.
        """
        u = np.ascontiguousarray(voltage, dtype=np.float64)
        y = np.ascontiguousarray(displacement, dtype=np.float64)
        if u.shape != y.shape or u.ndim != 1:
            raise IdentificationError(
                f'voltage has shape {u.shape}, displacement {y.shape}; give two columns of one '
                'length'
            )
        errors = np.empty_like(u)
        self._take(u, y, errors)
        return errors

    @property
    def _sigma(self) -> float:
        """Rms of the prediction error in the working unit, forgotten as the estimate is."""
        weight = self._m[self._WEIGHT_SUM]
        return sqrt(self._m[self._ERROR_SUM] / weight) if weight > 0 else 0.0

    @abstractmethod
    def _take(self, voltage: FloatArray, displacement: FloatArray, errors: FloatArray) -> None:
        """Update the estimate with samples [V], [m], and fill in their prediction errors [m]."""

    @abstractmethod
    def estimate(self) -> Estimate:
        """Return the present parameters in SI units."""

    @abstractmethod
    def free_run(self, voltage: FloatArray) -> FloatArray:
        """Simulate the present estimate from rest, with `voltage` [V]; return displacement [m]."""

    @abstractmethod
    def drive_at(self, frequency: float, start: float = 0.0) -> None:
        """Go on with another drive [Hz] from the time `start` [s], where it matters."""

    @abstractmethod
    def rest(self) -> None:
        """Begin another record: the actuator is at rest again, the estimate is kept."""

    @abstractmethod
    def reset(self) -> None:
        """Forget everything and start as the settings say."""
