"""Candidate models before and after a fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit import FitResult, fit
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import StageCache
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import PARAMETER_SHIFT, Candidate, Model, described

_Numbers = tuple[float, ...]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Added:
    """One effect that was added to a model."""

    effect: str  # name of the effect
    variant: str  # of its variant
    names: Mapping[str, str]  # map from the block's own parameter names to those of the model
    inexactness: float = 0.0  # share of the effect that its law does not describe [1]


def effect_of(added: Added) -> Effect:
    """Return the description of an added effect."""
    return next(e for e in described(added.effect) if e.variant == added.variant)


def added_of(candidate: Candidate) -> Added:
    """Return the effect that a candidate adds."""
    effect = candidate.effect
    return Added(effect.name, effect.variant, dict(candidate.renamed), effect.inexactness)


@dataclass(frozen=True)
class ModelSpec:
    """A model with parameter values, the starting point of a fit.

    Attributes
    ----------
    model : Model
        The chain.
    values : dict of str to float
        Value of every parameter.
    added : tuple of Added
        Effects in addition to the baseline, in the order of their selection.
    sampling_offset : float
        Delay of the displacement samples relative to the convention of this package [s].
    """

    model: Model
    values: dict[str, float]
    added: tuple[Added, ...] = ()
    sampling_offset: float = 0.0

    @property
    def effect(self) -> str:
        """Name of the last added effect; empty for a baseline."""
        return self.added[-1].effect if self.added else ''

    @property
    def variant(self) -> str:
        """Variant of the last added effect; empty for a baseline."""
        return self.added[-1].variant if self.added else ''

    @property
    def shifted(self) -> tuple[str, ...]:
        """Names of the baseline parameters that are fitted although the baseline is fixed."""
        changed = (each for each in self.added if each.effect == PARAMETER_SHIFT.name)
        return tuple(name for each in changed for name in each.names.values())

    def with_candidate(self, candidate: Candidate, values: Values) -> ModelSpec:
        """Return the model extended by the effect of a candidate, with the given values."""
        added = (*self.added, added_of(candidate))
        return ModelSpec(candidate.model, dict(values), added, self.sampling_offset)


@dataclass(frozen=True)
class CandidateFit(ModelSpec):
    """A model evaluated on views.

    Attributes
    ----------
    errors : tuple of ndarray
        Residual (measured minus simulated) of every view [m].
    noises : tuple of float
        Noise rms of every view [m].
    precisions : tuple of float
        Weight of every view.
    excess_deviations : tuple of float
        Relative standard deviation of the noise mean square of every view.
    levels : int
        Number of estimated voltage levels before the records.
    parameters : int
        Number of fitted parameters.
    fitted : FitResult or None
        Result of the fit; None if the model was only evaluated.
    """

    errors: tuple[FloatArray, ...] = ()
    noises: tuple[float, ...] = ()
    precisions: tuple[float, ...] = ()
    excess_deviations: tuple[float, ...] = ()
    levels: int = 0
    parameters: int = 0
    fitted: FitResult | None = None

    @property
    def weighted(self) -> tuple[FloatArray, ...]:
        """Residuals multiplied by the weight of their view [m]."""
        return tuple(e * p for e, p in zip(self.errors, self.precisions, strict=True))

    @property
    def square(self) -> float:
        """Weighted sum of squared residuals [m^2]."""
        pairs = zip(self.errors, self.precisions, strict=True)
        return sum(float(e @ e) * p**2 for e, p in pairs)

    @property
    def floors(self) -> float:
        """Rms of the residuals, each in units of the noise of its record."""
        pairs = zip(self.errors, self.noises, strict=True)
        total = sum(float(e @ e) / max(noise, 1e-150) ** 2 for e, noise in pairs)
        return float(np.sqrt(total / max(self.samples, 1)))

    @property
    def samples(self) -> int:
        """Number of residual samples."""
        return sum(e.size for e in self.errors)

    @property
    def rms(self) -> float:
        """Rms of the residuals [m]."""
        return float(np.sqrt(sum(float(e @ e) for e in self.errors) / max(self.samples, 1)))


# Finite-difference step of a parameter, relative to its value or to a hundredth of its scale.
_STEP = 1e-4


def nudged(spec: ModelSpec, name: str) -> dict[str, float]:
    """Return the parameter values with one of them changed by a small step within its bounds."""
    value = spec.values[name]
    row = next(q for q in spec.model.parameters if q.name == name)
    step = _STEP * max(abs(value), 1e-2 * row.scale)
    return {**spec.values, name: value + (step if value + step <= row.high else -step)}


def errors_of(
    spec: ModelSpec, views: Sequence[FitData], cache: StageCache | None = None
) -> tuple[FloatArray, ...]:
    """Return the residual (measured minus simulated) of every view [m]; infinite after divergence.

    Stages already simulated with the same parameters are taken from the `cache`.
    """
    packed = spec.model.pack(spec.values)
    errors = [
        Prediction(spec.model, packed, view, spec.sampling_offset, cache=cache).residual
        for view in views
    ]
    return tuple(np.where(np.isfinite(e), e, np.inf) for e in errors)


def evaluated_on(spec: ModelSpec, views: Sequence[FitData]) -> CandidateFit:
    """Return the model evaluated on views with its present values, without a fit."""
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
    views: Sequence[FitData],
    *,
    evaluations: int,
    tolerance: float,
    free: Sequence[str] | None = None,
    clock: tuple[float, float] | None = None,  # [s]
    enough: float = inf,
    derivatives: bool = True,
    stopped: Callable[[], bool] = lambda: False,
    workers: int = 1,
) -> CandidateFit | None:
    """Fit a model from its own values; return None if the fit fails."""
    low, high = clock or (0.0, views[0].dt)
    bounds = {**bounds_of(spec.model, views), SAMPLING_OFFSET: (low, high)}
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


def bounds_of(model: Model, views: Sequence[FitData]) -> dict[str, tuple[float, float]]:
    """Return the bounds of the parameters in a fit to the views."""
    return {
        **{q.name: (q.low, q.high) for q in model.parameters},
        **_below_half_the_rate(model, views[0].dt),
        **_not_below_the_noise(model, min(view.noise for view in views)),
    }


# Upper bound of fitted frequencies, relative to the sampling rate; it excludes aliases above half.
_HIGHEST = 0.49


def _below_half_the_rate(model: Model, dt: float) -> dict[str, tuple[float, float]]:
    free = (q for q in model.parameters if q.unit == 'Hz' and not q.held)
    return {q.name: (q.low, min(q.high, _HIGHEST / dt)) for q in free}


# Lower bound of positive lengths, relative to the noise.
_SHORTEST = 0.1


def _not_below_the_noise(model: Model, noise: float) -> dict[str, tuple[float, float]]:
    """Return bounds that keep fitted lengths above a share of the noise.

    Shorter lengths, over which a force builds up, have no visible effect. They require ever finer
    integration steps, which take a hundred times as long.
    """
    free = (q for q in model.parameters if q.unit == 'm' and q.low > 0.0 and not q.held)
    return {q.name: (min(max(q.low, _SHORTEST * noise), q.high), q.high) for q in free}


def _of_result(result: FitResult, added: tuple[Added, ...]) -> CandidateFit | None:
    """Return the result as a candidate fit, or None if its residuals are not finite."""
    if len(result.residuals) < len(result.targets):  # the fit did not start
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


def _weights(views: Sequence[FitData]) -> tuple[_Numbers, _Numbers, _Numbers, int]:
    return (
        tuple(view.noise for view in views),
        tuple(view.precision for view in views),
        tuple(view.excess_deviation for view in views),
        sum(view.begins.parameters for view in views),
    )


# A fitted time constant within this factor of the shortest possible one counts as zero.
_SHORT = 2.0
# Parameter of a tone, and relative distance from the drive up to which it is at its frequency.
_TONE, _AT_THE_DRIVE = 'hum_frequency', 0.1


def has_zero_time_constant(fit: CandidateFit, dt: float) -> bool:
    """Return whether a time constant of the last added effect was fitted as practically zero.

    Creep without a time constant is a gain; it would be mistaken for one if the gain is fixed.
    Time constants of the baseline, which a change of its parameters shares, are none of these.
    """
    own = set(fit.added[-1].names.values()).difference(fit.shifted) if fit.added else set()
    return any(
        q.unit == 's' and q.low > 0.0 and fit.values[q.name] <= _SHORT * max(q.low, dt)
        for q in fit.model.parameters
        if q.name in own
    )


def is_another_change(fit: CandidateFit) -> bool:
    """Return whether the fitted values of the last added effect describe another change."""
    if not fit.added:
        return False
    added = fit.added[-1]
    absent = effect_of(added).absent
    own = {name: fit.values[known] for name, known in added.names.items()}
    return absent is not None and absent({**fit.values, **own})


def is_at_the_drive(fit: CandidateFit, drives: Sequence[float]) -> bool:
    """Return whether the last added effect is a tone at the frequency of all drives [Hz].

    A drive whose period wanders keeps it apart from a line, but no record does from a new gain.
    """
    if not fit.added or _TONE not in fit.added[-1].names:
        return False
    frequency = fit.values[fit.added[-1].names[_TONE]]
    return all(abs(frequency - each) < _AT_THE_DRIVE * each for each in drives)
