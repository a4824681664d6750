"""One model fitted to the training views, and what is compared between models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, shifted
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model, answers_at_once

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
        Every parameter; ``sampling_offset`` besides them.
    errors : tuple of ndarray
        Measured minus simulated of every training view [m].
    parameters : int
        Number of fitted parameters.
    added : tuple of Added
        Effects that the model has beyond the baseline, in the order in which they came.
    fitted : FitResult or None
        The fit, where there was one.
    """

    model: Model
    values: dict[str, float]
    errors: tuple[FloatArray, ...]
    parameters: int
    added: tuple[Added, ...] = ()
    fitted: FitResult | None = None

    @property
    def effect(self) -> str:
        """Effect that came last; empty for a baseline."""
        return self.added[-1].effect if self.added else ''

    @property
    def variant(self) -> str:
        """How it enters."""
        return self.added[-1].variant if self.added else ''

    @property
    def square(self) -> float:
        """Sum of squared errors [m^2]."""
        return sum(float(e @ e) for e in self.errors)

    @property
    def samples(self) -> int:
        """Number of errors."""
        return sum(e.size for e in self.errors)

    @property
    def rms(self) -> float:
        """Rms of the errors [m]."""
        return float(np.sqrt(self.square / self.samples))


def simulate(model: Model, values: Values, view: Target) -> FloatArray:
    """Return what `model` says about the whole drive of `view` [m], shape (n,)."""
    own = {name: value for name, value in values.items() if name != SAMPLING_OFFSET}
    state = model.initial_state(view.dt, view.start)
    packed = model.pack(own)
    y = model.respond(view.voltage, packed, view.dt, state=state, frequency=view.frequency)
    late = values.get(SAMPLING_OFFSET, 0.0) / view.dt
    return shifted(y, late) if late else y


def errors_of(model: Model, values: Values, views: Sequence[Target]) -> tuple[FloatArray, ...]:
    """Return measured minus simulated of every view [m]; infinite where a model diverges."""
    with np.errstate(over='ignore', invalid='ignore'):
        errors = [v.measured - v.pick(simulate(model, values, v)) for v in views]
    return tuple(np.where(np.isfinite(e), e, np.inf) for e in errors)


def offset_bounds(model: Model, values: Values, dt: float) -> tuple[float, float]:
    """Return between what the sampling offset may lie without being an effect [s].

    A recording may have taken voltage and displacement of a tick together, or the displacement
    before the voltage acted. A chain that answers at once stands for the first, one whose
    structure holds the voltage for the second.
    """
    own = {name: value for name, value in values.items() if name != SAMPLING_OFFSET}
    return (-dt, 0.0) if answers_at_once(model, own, dt) else (0.0, dt)


def fit_trial(
    model: Model,
    values: Values,
    views: Sequence[Target],
    *,
    evaluations: int,
    offset: tuple[float, float] | None,
    added: tuple[Added, ...] = (),
) -> Trial | None:
    """Fit `model` from `values`; return None where it cannot be fitted at all.

    Parameters
    ----------
    offset : (low, high) or None
        Bounds of the sampling offset [s]; None fixes it at what `values` say.
    """
    start = dict(values)
    known = start.pop(SAMPLING_OFFSET, 0.0)
    bounds = _resolvable(model, views[0].dt)
    sampling: bool | float = float(known)
    if offset is not None:
        sampling = True
        bounds[SAMPLING_OFFSET] = offset
        start[SAMPLING_OFFSET] = float(np.clip(known, *offset))
    try:
        result = fit(
            model,
            (),
            start,
            targets=views,
            sampling_offset=sampling,
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
    values = {**result.values, SAMPLING_OFFSET: result.sampling_offset}
    count = len([name for name in result.free if name != SAMPLING_OFFSET])
    return Trial(result.model, values, errors, count, added, result)


def on_views(trial: Trial, views: Sequence[Target]) -> Trial:
    """Return the same model and values judged on other views."""
    return replace(trial, errors=errors_of(trial.model, trial.values, views), fitted=None)
