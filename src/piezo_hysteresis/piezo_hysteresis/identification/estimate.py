"""Current estimate of a recursive method."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.arrays import FloatArray
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
