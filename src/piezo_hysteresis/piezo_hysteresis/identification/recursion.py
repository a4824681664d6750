"""Base class of recursive estimators: sample updates, prediction errors, forgetting factor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import symmetric_eigen


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
    whole = np.all(np.isfinite(covariance))
    found = symmetric_eigen(correlation_of(covariance)) if whole else None
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


# Indices that all kernels share: in the memory, and in the constants.
SAMPLES, ERROR_SUM, WEIGHT_SUM = range(3)
FORGETTING = 0

# Name, unit, factor to SI and place of each parameter, in the order of the named model.
Layout = Sequence[tuple[str, str, float, int]]


@dataclass(frozen=True)
class OnlineSettings:
    """Settings of every recursive method."""

    forgetting: float = 1.0  # forgetting factor in (0, 1]
    dt: float = 1e-3  # sampling interval [s]

    def __post_init__(self) -> None:
        self._require_positive('dt')
        if not 0.0 < self.forgetting <= 1.0:
            raise IdentificationError(
                f'forgetting must be above 0 and at most 1, got {self.forgetting}'
            )

    def _require_positive(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise IdentificationError(f'{name} must be positive, got {value:g}')


class RecursionState(NamedTuple):
    """What a recursion changes from sample to sample, in the order in which kernels take it."""

    theta: FloatArray  # parameters in the working unit, shape (p,)
    covariance: FloatArray  # P, or the factor U of P = U diag(d) U', shape (p, p)
    rows: FloatArray  # d, columns of the regressor and work space, shape (r, p)
    memory: FloatArray  # sums, and signals since the last rest
    constants: FloatArray  # of the settings


class OnlineMethod(ABC):
    """A recursive estimator that is updated sample by sample.

    A subclass has the regressors of its models, a kernel with its update of the covariance, and
    the initial state. A copy of the estimator continues alike.

    Parameters
    ----------
    settings : RlsSettings or UdSettings
        Settings of the method; default: its defaults.

    Raises
    ------
    IdentificationError
        If the settings belong to another method, or an initial value is impossible.
    """

    #: Settings of the method.
    Settings: ClassVar[type[OnlineSettings]]
    #: Whether the prediction error is that of a free run.
    predicts_freely: ClassVar[bool] = False
    _kernel: ClassVar[Callable[..., None]]

    def __init__(self, settings: Any = None) -> None:
        self._settings: Any = self.Settings() if settings is None else settings
        if not isinstance(self._settings, self.Settings):
            raise IdentificationError(
                f'{type(settings).__name__} do not belong to {type(self).__name__}, which takes '
                f'{self.Settings.__name__}'
            )
        self._one = np.zeros((3, 1))
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
        self._state.constants[FORGETTING] = value

    def reset(self) -> None:
        """Reset to the initial values of the settings."""
        self._state = self._initial()

    def update(self, voltage: float, displacement: float) -> float:
        """Update with one sample: voltage [V], displacement [m]; return the prediction error [m].

        A sample whose displacement is not finite is skipped; its error is NaN.
        """
        u, y, error = self._one
        u[0], y[0] = voltage, displacement
        self._kernel(u, y, error, *self._state)
        return float(error[0])

    def update_many(self, voltage: FloatArray, displacement: FloatArray) -> FloatArray:
        """Update with samples, shapes (n,); return the prediction errors [m], bitwise as `update`.

        Raises
        ------
        IdentificationError
            If the two arrays differ in length.
        """
        # a kernel is compiled anew for arrays that cannot be written
        u, y = (np.require(each, np.float64, ['C', 'W']) for each in (voltage, displacement))
        if u.shape != y.shape or u.ndim != 1:
            raise IdentificationError(
                f'voltage has shape {u.shape}, displacement {y.shape}; give two columns of one '
                'length'
            )
        errors = np.empty_like(u)
        self._kernel(u, y, errors, *self._state)
        return errors

    @property
    def _sigma(self) -> float:
        """Rms of the prediction error in the working unit, with the forgetting factor."""
        weight = self._state.memory[WEIGHT_SUM]
        return sqrt(self._state.memory[ERROR_SUM] / weight) if weight > 0 else 0.0

    def _estimate(
        self, layout: Layout, theta: FloatArray, covariance: FloatArray, one_step_rms: float
    ) -> Estimate:
        """Return parameters and covariance in the working unit as an estimate in SI units."""
        names, units, factors, order = zip(*layout, strict=True)
        scale, covariance = np.array(factors), covariance[np.ix_(order, order)]
        return Estimate(
            names=names,
            units=units,
            values=theta[list(order)] * scale,
            standard_deviations=self._sigma * np.sqrt(np.abs(np.diag(covariance))) * np.abs(scale),
            one_step_rms=one_step_rms,
            samples=int(self._state.memory[SAMPLES]),
            condition_number=scaled_condition(covariance),
            correlation=correlation_of(covariance) * np.outer(np.sign(scale), np.sign(scale)),
        )

    @abstractmethod
    def _initial(self) -> RecursionState:
        """Return the state before the first sample."""

    @abstractmethod
    def rest(self) -> None:
        """Start a new record from rest and keep the estimate."""

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
