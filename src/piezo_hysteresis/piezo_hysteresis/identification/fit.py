"""A fit and its result: values, uncertainty, residuals and convergence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit_data import FitData, targets_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective, Prior
from piezo_hysteresis.identification.solver import Progress, Solution, solve
from piezo_hysteresis.identification.uncertainty import (
    Covariance,
    covariance,
    cramer_rao,
    inflation,
    warnings_of,
)
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record


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
    targets : tuple of FitData
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
    targets: tuple[FitData, ...]
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


def pooled_noise(targets: Sequence[FitData]) -> float:
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
        zeros = objective.model.zero_names  # not determined by records with a zero of their own
        lost = np.array([name in zeros for name in names], dtype=bool)
        spread = replace(spread, std=np.where(lost, np.inf, spread.std))
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


#: Largest sampling offset from the convention, in samples.
FARTHEST = 2.0


def fit(
    model: Model,
    records: Sequence[Record],
    start: Mapping[str, float] | None = None,
    *,
    free: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, Prior] | None = None,
    weights: str | Mapping[str, float] = 'equal',
    folded: bool = True,
    stride: int = 1,
    sampling_offset: bool | float = False,
    max_evaluations: int = 100,
    tolerance: float = 1e-9,
    enough: float = inf,
    derivatives: bool = True,
    stopped: Callable[[], bool] = lambda: False,
    workers: int = 1,
    targets: Sequence[FitData] | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a chain to records by free-run least squares from one start.

    Parameters
    ----------
    model : Model
        Any chain; held parameters stay.
    records : sequence of Record
        Fitted jointly. Ignored where `targets` are given.
    start : mapping of str to float, optional
        Start values; the default is that of the model.
    free : sequence of str, optional
        Parameters to fit; by default all free parameters of the model.
    bounds : mapping of str to (low, high), optional
        Narrower bounds than those of the model.
    priors : mapping of str to Prior, optional
        Priors; they require folded records, whose noise determines the weight.
    weights : str or mapping of str to float
        ``equal``: absolute errors. ``relative``: errors relative to the motion of the record. Or
        a factor by record name.
    folded : bool
        Compare mean periods of periodic records; a model with a slow block (creep, drift) has no
        steady period and is always fitted to whole records.
    stride : int
        Compare every `stride`-th sample of whole records.
    sampling_offset : bool or float
        True fits the delay of the displacement samples, within two samples; or its value [s].
    max_evaluations, tolerance, enough, derivatives, stopped
        See `solver.solve`.
    workers : int
        Threads; the result is the same for any number.
    targets : sequence of FitData, optional
        Prepared by `targets_of`, so that the records are folded once for many models.
    progress : callable, optional
        Called with ``(fraction, words)``.

    Returns
    -------
    FitResult
        Also without convergence; check `converged` and `warnings`.

    Raises
    ------
    IdentificationError
        If there is nothing to fit, or a name is unknown.
    """
    if targets is None:
        slow = any(block.slot == Slot.SLOW for block in model.blocks)
        targets = targets_of(records, folded=folded and not slow, stride=stride)
    if not targets:
        raise IdentificationError('there is no record to fit; give at least one')
    names, values = _unknowns(model, start, free, sampling_offset)
    limits = {q.name: (q.low, q.high) for q in model.parameters}
    farthest = FARTHEST * min(t.dt for t in targets)
    limits[SAMPLING_OFFSET] = (-farthest, farthest)
    for name, (low, high) in (bounds or {}).items():
        if name in limits:
            limits[name] = (max(low, limits[name][0]), min(high, limits[name][1]))
    lowest, highest = np.array([limits[name] for name in names]).T
    noise = pooled_noise(targets) if priors else 0.0
    if np.isnan(noise):
        raise IdentificationError(
            'priors need the noise of the records; record at least two periods, or leave them out'
        )
    objective = Objective(
        model,
        targets,
        names,
        values,
        weights=target_weights(targets, weights),
        priors=priors,
        noise=noise,
        workers=workers,
    )
    begin = np.array([values[name] for name in names])
    solution = solve(
        objective,
        begin,
        lowest,
        highest,
        max_evaluations=max_evaluations,
        tolerance=tolerance,
        enough=enough,
        derivatives=derivatives,
        stopped=stopped,
        progress=progress,
    )
    return result_of(objective, solution)


def _unknowns(
    model: Model,
    start: Mapping[str, float] | None,
    free: Sequence[str] | None,
    sampling_offset: bool | float,
) -> tuple[tuple[str, ...], dict[str, float]]:
    values = {**model.defaults(), **(start or {})}
    chosen = tuple(model.free_names if free is None else free)
    unknown = sorted({*chosen, *values} - {*model.parameter_names, SAMPLING_OFFSET})
    if unknown:
        raise IdentificationError(
            f'model {model.name} has no parameter {", ".join(unknown)}'
            f'{near(unknown[0], model.parameter_names)}; it has '
            f'{", ".join(model.parameter_names)}'
        )
    if sampling_offset is True:
        if SAMPLING_OFFSET not in chosen:
            chosen = (*chosen, SAMPLING_OFFSET)
        values.setdefault(SAMPLING_OFFSET, 0.0)
    elif sampling_offset is not False:
        values[SAMPLING_OFFSET] = float(sampling_offset)
    if not chosen:
        raise IdentificationError(f'model {model.name} has no free parameter; name some in free')
    return chosen, values


def target_weights(targets: Sequence[FitData], weights: str | Mapping[str, float]) -> list[float]:
    """Return the factor of each target's residual.

    ``relative`` divides by the motion of the record, but a record that hardly moves counts at most
    ten times as much as the one that moves most.
    """
    if not isinstance(weights, str):
        return [float(weights.get(t.name, 1.0)) for t in targets]
    if weights == 'equal':
        return [1.0] * len(targets)
    if weights == 'relative':
        motion = np.array([float(np.std(t.measured)) for t in targets])
        largest = float(motion.max()) or 1.0
        return [float(largest / m) for m in np.maximum(motion, 0.1 * largest)]
    raise IdentificationError(f'weights {weights!r} are unknown; choose equal or relative')
