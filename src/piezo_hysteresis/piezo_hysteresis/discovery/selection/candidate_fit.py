"""A model that may be missing something, before it is fitted and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.free_run import StageCache
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import PARAMETER_SHIFT, Candidate, Model

_Numbers = tuple[float, ...]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Added:
    """One effect that a model has been given.

    Attributes
    ----------
    effect, variant : str
        Its name, and the variant in which it enters.
    names : mapping of str to str
        The block's own parameter names to those of the model.
    inexactness : float
        Share of the effect that its law is known not to describe [1].
    """

    effect: str
    variant: str
    names: Mapping[str, str]
    inexactness: float = 0.0


def added_of(candidate: Candidate) -> Added:
    """Return what a candidate adds."""
    effect = candidate.effect
    return Added(effect.name, effect.variant, dict(candidate.renamed), effect.inexactness)


@dataclass(frozen=True)
class ModelSpec:
    """A model and where a fit of it starts.

    Attributes
    ----------
    model : Model
        The chain.
    values : dict of str to float
        Every parameter.
    added : tuple of Added
        Effects that the model has beyond the baseline, in the order in which they came.
    sampling_offset : float
        By how much later than our convention the displacement was sampled [s].
    """

    model: Model
    values: dict[str, float]
    added: tuple[Added, ...] = ()
    sampling_offset: float = 0.0

    @property
    def effect(self) -> str:
        """Effect that came last; empty for a baseline."""
        return self.added[-1].effect if self.added else ''

    @property
    def variant(self) -> str:
        """How it enters."""
        return self.added[-1].variant if self.added else ''

    @property
    def shifted(self) -> tuple[str, ...]:
        """Names of what the baseline had already and what is fitted all the same."""
        changed = (each for each in self.added if each.effect == PARAMETER_SHIFT.name)
        return tuple(name for each in changed for name in each.names.values())

    def with_candidate(self, candidate: Candidate, values: Values) -> ModelSpec:
        """Return the model of a candidate, which this one is without its effect."""
        added = (*self.added, added_of(candidate))
        return ModelSpec(candidate.model, dict(values), added, self.sampling_offset)


@dataclass(frozen=True)
class CandidateFit(ModelSpec):
    """A model judged on views.

    Attributes
    ----------
    errors : tuple of ndarray
        Measured minus simulated of every view [m].
    noises : tuple of float
        Noise of every view [m].
    precisions : tuple of float
        Weight of every view.
    doubts : tuple of float
        Standard deviation of the mean square that noise leaves of every view, as a share of it.
    parameters : int
        Number of fitted parameters.
    fitted : FitResult or None
        The fit, where there was one.
    """

    errors: tuple[FloatArray, ...] = ()
    noises: tuple[float, ...] = ()
    precisions: tuple[float, ...] = ()
    doubts: tuple[float, ...] = ()
    parameters: int = 0
    fitted: FitResult | None = None

    @property
    def weighted(self) -> tuple[FloatArray, ...]:
        """Errors, each view by its weight [m]."""
        return tuple(e * p for e, p in zip(self.errors, self.precisions, strict=True))

    @property
    def square(self) -> float:
        """Weighted sum of squared errors [m^2]."""
        pairs = zip(self.errors, self.precisions, strict=True)
        return sum(float(e @ e) * p**2 for e, p in pairs)

    @property
    def floors(self) -> float:
        """Rms of the errors, each in multiples of the noise of its record."""
        pairs = zip(self.errors, self.noises, strict=True)
        total = sum(float(e @ e) / max(noise, 1e-150) ** 2 for e, noise in pairs)
        return float(np.sqrt(total / max(self.samples, 1)))

    @property
    def samples(self) -> int:
        """Number of errors."""
        return sum(e.size for e in self.errors)

    @property
    def rms(self) -> float:
        """Rms of the errors [m]."""
        return float(np.sqrt(sum(float(e @ e) for e in self.errors) / max(self.samples, 1)))


# Step towards a parameter, as a share of its value or of a hundredth of its scale.
_STEP = 1e-4


def nudged(spec: ModelSpec, name: str) -> dict[str, float]:
    """Return the values of a model with one of them a small step away, within its bounds."""
    value = spec.values[name]
    row = next(q for q in spec.model.parameters if q.name == name)
    step = _STEP * max(abs(value), 1e-2 * row.scale)
    return {**spec.values, name: value + (step if value + step <= row.high else -step)}


def errors_of(
    spec: ModelSpec, views: Sequence[Target], cache: StageCache | None = None
) -> tuple[FloatArray, ...]:
    """Return measured minus simulated of every view [m]; infinite where a model diverges.

    Stages that a model like it has simulated are taken from the `cache`.

    Raises
    ------
    PiezoError
        If a value is impossible.
    """
    packed = spec.model.pack(spec.values)
    with np.errstate(over='ignore', invalid='ignore'):
        errors = [
            Prediction(spec.model, packed, view, spec.sampling_offset, cache=cache).residual
            for view in views
        ]
    return tuple(np.where(np.isfinite(e), e, np.inf) for e in errors)


def judged_on(spec: ModelSpec, views: Sequence[Target]) -> CandidateFit:
    """Return a model with these values judged on views, to which it was not fitted."""
    parameters = spec.parameters if isinstance(spec, CandidateFit) else 0
    return CandidateFit(
        spec.model,
        spec.values,
        spec.added,
        spec.sampling_offset,
        errors_of(spec, views),
        *_weights(views),
        parameters,
    )


def fitted_to(
    spec: ModelSpec,
    views: Sequence[Target],
    *,
    evaluations: int,
    tolerance: float,
    free: Sequence[str] | None = None,
    clock: tuple[float, float] | None = None,
    enough: float = inf,
    derivatives: bool = True,
    stopped: Callable[[], bool] = lambda: False,
    workers: int = 1,
) -> CandidateFit | None:
    """Fit a model from its own values; return None where it cannot be fitted at all.

    Parameters
    ----------
    spec, views
        What is fitted, and to what.
    evaluations : int
        Limit of the fit.
    tolerance : float
        Relative decrease that counts as none.
    free : sequence of str, optional
        What is fitted; everything that the model does not hold where not given.
    clock : (float, float), optional
        Between what the sampling offset may lie [s]. Where not given, a recording may have taken
        the displacement before the voltage of a tick acted, which is our convention, or both
        together, which is as much as a tick later.
    enough : float
        Sum of squares, as of `CandidateFit`, from which on a fit is of use, see `solver.solve`.
    derivatives : bool
        Whether those at the end are of use, see `solver.solve`.
    stopped : callable
        Asked before each step of the fit whether there is no time for it.
    workers : int
        Threads over the views; the result does not depend on it.
    """
    low, high = clock or (0.0, views[0].dt)
    bounds = {
        **_below_half_the_rate(spec.model, views[0].dt),
        **_not_below_the_noise(spec.model, min(view.noise for view in views)),
        SAMPLING_OFFSET: (low, high),
    }
    start = {**spec.values, SAMPLING_OFFSET: float(np.clip(spec.sampling_offset, low, high))}
    try:
        result = fit(
            spec.model,
            (),
            start,
            free=free,
            targets=views,
            sampling_offset=True,
            bounds=bounds,
            max_evaluations=evaluations,
            tolerance=tolerance,
            enough=0.5 * enough,
            derivatives=derivatives,
            stopped=stopped,
            workers=workers,
        )
    except PiezoError:
        return None
    return _of_result(result, spec.added)


# Frequencies are looked for below this share of the sampling rate, off their aliases above half.
_HIGHEST = 0.49


def _below_half_the_rate(model: Model, dt: float) -> dict[str, tuple[float, float]]:
    free = (q for q in model.parameters if q.unit == 'Hz' and not q.held)
    return {q.name: (q.low, min(q.high, _HIGHEST / dt)) for q in free}


# Lengths that must be positive are looked for from this share of the noise on.
_SHORTEST = 0.1


def _not_below_the_noise(model: Model, noise: float) -> dict[str, tuple[float, float]]:
    """Return bounds of lengths within which a force is built up: shorter ones show nothing.

    A model follows them in ever finer steps, and would take a hundred times as long.
    """
    free = (q for q in model.parameters if q.unit == 'm' and q.low > 0.0 and not q.held)
    return {q.name: (min(max(q.low, _SHORTEST * noise), q.high), q.high) for q in free}


def _of_result(result: FitResult, added: tuple[Added, ...]) -> CandidateFit | None:
    """Return a fit, or None where its errors are not finite."""
    if len(result.residuals) < len(result.targets):  # the fit could not even begin
        return None
    errors = tuple(result.residuals[t.name] for t in result.targets)
    if not all(np.all(np.isfinite(e)) for e in errors):
        return None
    count = len([name for name in result.free if name != SAMPLING_OFFSET])
    return CandidateFit(
        result.model,
        result.values,
        added,
        result.sampling_offset,
        errors,
        *_weights(result.targets),
        count,
        result,
    )


def _weights(views: Sequence[Target]) -> tuple[_Numbers, _Numbers, _Numbers]:
    return (
        tuple(view.noise for view in views),
        tuple(view.precision for view in views),
        tuple(view.doubt for view in views),
    )


# A time that ends within this factor of the shortest one is none.
_SHORT = 2.0


def takes_no_time(fit: CandidateFit, dt: float) -> bool:
    """Return whether what came last was fitted as if it happened at once.

    Creep without a time is a gain, and where the gain is held it would pass for one.
    """
    own = set(fit.added[-1].names.values()) if fit.added else set()
    return any(
        q.unit == 's' and q.low > 0.0 and fit.values[q.name] <= _SHORT * max(q.low, dt)
        for q in fit.model.parameters
        if q.name in own
    )
