"""One model fitted to the training views, and what is compared between models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.opening import misfit
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model

Values = Mapping[str, float]


# Modes, tones and other lines are looked for below this share of the sampling rate.
HIGHEST = 0.49
_FREQUENCIES = ('natural_frequency', 'resonance_frequency', 'hum_frequency')


@dataclass(frozen=True)
class Added:
    """One effect that a model has been given.

    Attributes
    ----------
    effect, variant : str
        Its word, and the way in which it enters.
    names : mapping of str to str
        The block's own parameter names to those of the model.
    """

    effect: str
    variant: str
    names: Mapping[str, str]


@dataclass(frozen=True)
class Trial:
    """A model with fitted values.

    Attributes
    ----------
    model : Model
        The chain.
    values : dict of str to float
        Every parameter.
    errors : tuple of ndarray
        Measured minus simulated of every training view [m].
    parameters : int
        Number of fitted parameters.
    added : tuple of Added
        Effects that the model has beyond the baseline, in the order in which they came.
    fitted : FitResult or None
        The fit, where there was one.
    sampling_offset : float
        By how much later than our convention the displacement was sampled [s].
    noises : tuple of float
        Noise of every view [m].
    precisions : tuple of float
        Weight of every view.
    """

    model: Model
    values: dict[str, float]
    errors: tuple[FloatArray, ...]
    parameters: int
    added: tuple[Added, ...] = ()
    fitted: FitResult | None = None
    sampling_offset: float = 0.0
    noises: tuple[float, ...] = ()
    precisions: tuple[float, ...] = ()

    @property
    def effect(self) -> str:
        """Effect that came last; empty for a baseline."""
        return self.added[-1].effect if self.added else ''

    @property
    def variant(self) -> str:
        """How it enters."""
        return self.added[-1].variant if self.added else ''

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
        total = sum(float(e @ e) / max(noise, 1e-300) ** 2 for e, noise in pairs)
        return float(np.sqrt(total / max(self.samples, 1)))

    @property
    def samples(self) -> int:
        """Number of errors."""
        return sum(e.size for e in self.errors)

    @property
    def rms(self) -> float:
        """Rms of the errors [m]."""
        return float(np.sqrt(sum(float(e @ e) for e in self.errors) / max(self.samples, 1)))


def errors_of(
    model: Model, values: Values, views: Sequence[Target], sampling_offset: float = 0.0
) -> tuple[FloatArray, ...]:
    """Return measured minus simulated of every view [m]; infinite where a model diverges."""
    packed = model.pack(values)
    with np.errstate(over='ignore', invalid='ignore'):
        errors = [misfit(model, packed, view, sampling_offset) for view in views]
    return tuple(np.where(np.isfinite(e), e, np.inf) for e in errors)


def offset_bounds(dt: float) -> tuple[float, float]:
    """Return between what the sampling offset may lie without being an effect [s].

    A recording may have taken the displacement before the voltage of a tick acted, which is our
    convention, or both together, which is as much as a tick later.
    """
    return 0.0, dt


def fit_trial(
    model: Model,
    values: Values,
    views: Sequence[Target],
    *,
    evaluations: int,
    sampling_offset: float = 0.0,
    added: tuple[Added, ...] = (),
    free: Sequence[str] | None = None,
    clock: tuple[float, float] | None = None,
) -> Trial | None:
    """Fit `model` from `values`; return None where it cannot be fitted at all.

    Parameters
    ----------
    model, values, views
        What is fitted, from where, and to what.
    evaluations : int
        Limit of the fit.
    sampling_offset : float
        Where that of the recording begins [s]; it is fitted besides.
    added : tuple of Added
        What the model has beyond the baseline.
    free : sequence of str, optional
        What is fitted; everything that the model does not hold where not given.
    clock : (float, float), optional
        Between what the sampling offset may lie [s]; see `offset_bounds` where not given.
    """
    low, high = clock or offset_bounds(views[0].dt)
    bounds = {**_resolvable(model, views[0].dt), SAMPLING_OFFSET: (low, high)}
    start = {**values, SAMPLING_OFFSET: float(np.clip(sampling_offset, low, high))}
    try:
        result = fit(
            model,
            (),
            start,
            free=free,
            targets=views,
            sampling_offset=True,
            bounds=bounds,
            max_evaluations=evaluations,
            tolerance=1e-7,
        )
    except PiezoError:
        return None
    return of_result(result, added)


def _resolvable(model: Model, dt: float) -> dict[str, tuple[float, float]]:
    """Bounds that keep frequencies off their aliases above half the sampling rate."""
    return {
        q.name: (q.low, HIGHEST / dt)
        for q in model.parameters
        if q.name.startswith(_FREQUENCIES) and not q.held
    }


def of_result(result: FitResult, added: tuple[Added, ...] = ()) -> Trial | None:
    """Return a fit as a trial, or None where its errors are not finite."""
    if len(result.residuals) < len(result.targets):  # the fit could not even begin
        return None
    errors = tuple(result.residuals[t.name] for t in result.targets)
    if not all(np.all(np.isfinite(e)) for e in errors):
        return None
    count = len([name for name in result.free if name != SAMPLING_OFFSET])
    trial = Trial(
        result.model, result.values, errors, count, added, result, result.sampling_offset
    )
    return _weighted_as(trial, result.targets)


def on_views(trial: Trial, views: Sequence[Target]) -> Trial:
    """Return the same model and values judged on other views."""
    errors = errors_of(trial.model, trial.values, views, trial.sampling_offset)
    return _weighted_as(replace(trial, errors=errors, fitted=None), views)


def _weighted_as(trial: Trial, views: Sequence[Target]) -> Trial:
    return replace(
        trial,
        noises=tuple(view.noise for view in views),
        precisions=tuple(view.precision for view in views),
    )
