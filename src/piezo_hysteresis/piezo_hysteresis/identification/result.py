"""Result of a fit: values, uncertainty, residuals and convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.solver import Solution
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.identification.uncertainty import (
    Covariance,
    covariance,
    cramer_rao,
    inflation,
    warnings_of,
)
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.qr import inner


@dataclass(frozen=True)
class FitResult:
    """A fitted chain with the details of the fit.

    Attributes
    ----------
    model : Model
        The chain.
    values : dict of str to float
        Every parameter of the chain, fixed ones included.
    free : tuple of str
        Names of the fitted unknowns; may hold ``sampling_offset``.
    sampling_offset : float
        Delay of the displacement samples relative to the convention [s]; a nuisance parameter.
    covariance : Covariance
        Standard deviations, correlations, condition number, directions not determined.
    cost : float
        Half the weighted sum of squares [m^2].
    residuals : dict of str to ndarray
        Measured minus simulated displacement by record [m]; of the mean period where folded.
    targets : tuple of Target
        Data of the fit.
    converged : bool
        Whether a tolerance was met.
    message : str
        Reason for the termination of the solver.
    warnings : tuple of str
        Sentences on what the records do not determine.
    history : tuple of float
        Rms of the error over all samples after every accepted step [m].
    evaluations : int
        Simulations of the data set.
    """

    model: Model
    values: dict[str, float]
    free: tuple[str, ...]
    sampling_offset: float
    covariance: Covariance
    cost: float
    residuals: dict[str, FloatArray]
    targets: tuple[Target, ...]
    converged: bool
    message: str
    warnings: tuple[str, ...]
    history: tuple[float, ...]
    evaluations: int
    objective: Objective
    solution: Solution

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of every fitted unknown, in its unit."""
        return dict(zip(self.free, (float(s) for s in self.covariance.std), strict=True))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix in the order of `free`, shape (p, p)."""
        return self.covariance.correlation

    @property
    def condition(self) -> float:
        """Condition number of the column-scaled Jacobian."""
        return self.covariance.condition

    @property
    def x(self) -> FloatArray:
        """Fitted unknowns in the order of `free`, shape (p,)."""
        return self.solution.x

    @cached_property
    def rms(self) -> float:
        """Rms of the error over all compared samples [m]."""
        return sqrt(
            sum(inner(e, e) for e in self.residuals.values())
            / sum(e.size for e in self.residuals.values())
        )

    @cached_property
    def noise(self) -> float:
        """Pooled noise of one sample [m] from period to period; NaN without folded records."""
        return pooled_noise(self.targets)

    @cached_property
    def jacobian(self) -> dict[str, FloatArray]:
        """Derivatives of the simulated samples by record, shapes (m, p) [m per unit]."""
        return {
            target.name: np.ascontiguousarray(self.objective.jacobian(target, self.x)[1].T)
            for target in self.targets
        }

    def cramer_rao(self, noise: float) -> dict[str, float]:
        """Return the smallest standard deviations that white noise of rms `noise` [m] allows."""
        bound = cramer_rao(self.solution.factor, noise)
        return dict(zip(self.free, (float(b) for b in bound), strict=True))


def pooled_noise(targets: Sequence[Target]) -> float:
    """Return the noise of one sample over all targets [m]; NaN if unknown."""
    known = {t.name: t for t in targets if np.isfinite(t.noise)}.values()
    if not known:
        return float('nan')
    samples = np.array([t.measured.size * t.repeats for t in known])
    return sqrt(float(np.average([t.noise**2 for t in known], weights=samples)))


def result_of(objective: Objective, solution: Solution) -> FitResult:
    """Return the result of a fit from the `solution` of its solver."""
    p = len(objective.free)
    names = objective.free
    possible = np.isfinite(solution.cost)
    residuals = objective.residuals(solution.x) if possible else []
    freedom = max(sum(e.size for e in residuals) - p, 1)
    variance = 2 * solution.cost / freedom * inflation(residuals) if possible else float('inf')
    spread = covariance(solution.factor, variance, names)
    if all(target.own_zero for target in objective.targets):
        spread = _without_zero(spread, objective)
    values = objective.values(solution.x)
    late = values.pop(SAMPLING_OFFSET, 0.0)
    remarks = list(warnings_of(spread, names, solution.x))
    remarks += [
        f'{name} is at its bound {value:.4g}: the records require a value beyond it.'
        for name, value, on in zip(names, solution.x, solution.at_bound, strict=True)
        if on
    ]
    if not solution.converged:
        remarks.insert(0, f'the fit did not converge ({solution.message}): trust no digit of it.')
    return FitResult(
        model=objective.model,
        values=values,
        free=names,
        sampling_offset=late,
        covariance=spread,
        cost=solution.cost,
        residuals={t.name: e for t, e in zip(objective.targets, residuals, strict=False)},
        targets=objective.targets,
        converged=solution.converged,
        message=solution.message,
        warnings=tuple(remarks),
        history=tuple(sqrt(2 * cost / (freedom + p)) for cost in solution.history),
        evaluations=solution.evaluations,
        objective=objective,
        solution=solution,
    )


def _without_zero(spread: Covariance, objective: Objective) -> Covariance:
    """Return the covariance with an infinite deviation of the offset, for one zero per record."""
    zeros = objective.model.zero_names
    lost = np.array([name in zeros for name in objective.free], dtype=bool)
    return replace(spread, std=np.where(lost, np.inf, spread.std))


def result_at(
    objective: Objective,
    values: Mapping[str, float],
    *,
    converged: bool,
    message: str,
    evaluations: int,
    history: tuple[float, ...],
) -> FitResult:
    """Return the result of another method that ended at `values`, with its uncertainty there."""
    x = np.array([values[name] for name in objective.free])
    factor, _, cost = objective.linearise(x)
    at_bound = (False,) * x.size
    return result_of(
        objective, Solution(x, factor, cost, converged, message, evaluations, history, at_bound)
    )
