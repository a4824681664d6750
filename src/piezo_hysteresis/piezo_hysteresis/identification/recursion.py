"""Base class of recursive estimators: sample updates, prediction errors, forgetting factor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import symmetric_eigen

#: Factors from metres to the working unit of a recursive method.
WORKING_UNITS = {'m': 1.0, 'mm': 1e3, 'um': 1e6, 'nm': 1e9}


@dataclass(frozen=True)
class Estimate:
    """Current parameter estimate of a recursive method, in SI units.

    Attributes
    ----------
    names : tuple of str
        Parameter names, those of the named model `model`.
    units : tuple of str
        SI unit of each parameter.
    values : ndarray, shape (p,)
        Estimates.
    standard_deviations : ndarray, shape (p,)
        From the covariance and the one-step scatter; they hold only if the model is correct, and
        do not include bias.
    one_step_rms : float
        Rms of the one-step prediction error [m], with the forgetting factor of the method.
    samples : int
        Number of processed samples.
    condition_number : float
        Condition number of the covariance scaled to unit diagonal: near 1 if the data determine
        the parameters, above 1e8 if they do not.
    notes : tuple of str
        Remarks on the estimate, in sentences.
    model : str
        Named model of the parameters; empty if there is none.
    correlation : ndarray, shape (p, p)
        Correlation matrix.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    standard_deviations: FloatArray
    one_step_rms: float
    samples: int
    condition_number: float
    notes: tuple[str, ...] = ()
    model: str = ''
    correlation: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def parameters(self) -> dict[str, float]:
        """Return the estimates by name, as `Model.pack` reads them."""
        return dict(zip(self.names, (float(value) for value in self.values), strict=True))


def scaled_condition(covariance: FloatArray) -> float:
    """Return the condition number of a covariance, shape (p, p), scaled to unit diagonal."""
    if not np.all(np.isfinite(covariance)):
        return float('inf')
    spread = np.sqrt(np.abs(np.diag(covariance)))
    spread[spread == 0.0] = 1.0
    found = symmetric_eigen(covariance / np.outer(spread, spread))
    if found is None:
        return float('inf')
    eigenvalues = found[0]
    least = float(eigenvalues[0])
    return float(eigenvalues[-1]) / least if least > 0 else float('inf')


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix of a covariance, shape (p, p); zero where nothing varies."""
    spread = np.sqrt(np.abs(np.diag(covariance)))
    spread[spread == 0.0] = 1.0
    return np.asarray(covariance / np.outer(spread, spread))


# Indices that all kernels share: in the memory `_m`, and in the kernel settings `_c`.
SAMPLES, ERROR_SUM, WEIGHT_SUM = range(3)
FORGETTING = 0

# Names, units, factors to SI, and the places of the parameters in the order of the named model.
Layout = tuple[Sequence[str], Sequence[str], Sequence[float], Sequence[int]]


def check_settings(settings: Any, *positive: str) -> None:
    """Raise an error for a forgetting factor outside (0, 1] or numbers that are not positive."""
    for name in positive:
        value = getattr(settings, name)
        if not (np.isfinite(value) and value > 0.0):
            raise IdentificationError(f'{name} must be positive, got {value:g}')
    if not 0.0 < settings.forgetting <= 1.0:
        raise IdentificationError(
            f'forgetting must be above 0 and at most 1, got {settings.forgetting}'
        )


class OnlineMethod(ABC):
    """A recursive estimator that is updated sample by sample.

    A subclass has the kernel and the regressors of its models. The state is the parameters
    `_theta`, the memory `_m` and arrays of the update; a copy of the estimator continues alike.

    Parameters
    ----------
    settings : RlsSettings or UdSettings
        Settings of the method.
    """

    #: Whether the prediction error is that of a free run.
    predicts_freely: ClassVar[bool] = False

    def __init__(self, settings: Any) -> None:
        self._settings = settings
        self._one = np.zeros((3, 1))
        self._theta, self._c, self._m = np.zeros(0), np.zeros(0), np.zeros(0)
        self.reset()

    @property
    def settings(self) -> Any:
        """Current settings."""
        return self._settings

    @property
    def forgetting(self) -> float:
        """Forgetting factor; can be changed at run time."""
        return float(self._settings.forgetting)

    @forgetting.setter
    def forgetting(self, value: float) -> None:
        self._settings = replace(self._settings, forgetting=value)
        self._c[FORGETTING] = value

    def update(self, voltage: float, displacement: float) -> float:
        """Update with one sample: voltage [V], displacement [m]; return the prediction error [m].

        A sample whose displacement is not finite is skipped; its error is NaN.
        """
        u, y, error = self._one
        u[0], y[0] = voltage, displacement
        self._take(u, y, error)
        return float(error[0])

    def update_many(self, voltage: FloatArray, displacement: FloatArray) -> FloatArray:
        """Update with samples, shapes (n,); return the prediction errors [m], bitwise as `update`.

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
        """Rms of the prediction error in the working unit, with the forgetting factor."""
        weight = self._m[WEIGHT_SUM]
        return sqrt(self._m[ERROR_SUM] / weight) if weight > 0 else 0.0

    def _estimate(
        self, layout: Layout, theta: FloatArray, covariance: FloatArray, one_step_rms: float
    ) -> Estimate:
        """Return parameters and covariance in the working unit as an estimate in SI units."""
        names, units, factors, order = layout
        scale, covariance = np.array(factors), covariance[np.ix_(order, order)]
        return Estimate(
            names=tuple(names),
            units=tuple(units),
            values=theta[list(order)] * scale,
            standard_deviations=self._sigma * np.sqrt(np.abs(np.diag(covariance))) * np.abs(scale),
            one_step_rms=one_step_rms,
            samples=int(self._m[SAMPLES]),
            condition_number=scaled_condition(covariance),
            correlation=correlation_of(covariance) * np.outer(np.sign(scale), np.sign(scale)),
        )

    @abstractmethod
    def _take(self, voltage: FloatArray, displacement: FloatArray, errors: FloatArray) -> None:
        """Update the estimate with samples [V], [m], and fill in their prediction errors [m]."""

    @abstractmethod
    def estimate(self) -> Estimate:
        """Return the current estimate of the parameters in SI units."""

    @abstractmethod
    def model(self) -> Model | None:
        """Return the chain with the parameters of `estimate`, None where there is none."""

    @abstractmethod
    def free_run(self, voltage: FloatArray) -> FloatArray:
        """Simulate the estimate from rest for `voltage` [V]; return the displacement [m]."""

    def drive_at(self, frequency: float, start: float = 0.0) -> None:  # noqa: B027
        """Set the drive frequency [Hz] from the time `start` [s] on, if it is used."""

    @abstractmethod
    def rest(self) -> None:
        """Start a new record from rest and keep the estimate."""

    @abstractmethod
    def reset(self) -> None:
        """Reset to the initial values of the settings."""
