"""The baseline before any effect is added.

A refit hides an effect in wrong parameters, so three versions are kept: the nominal one if a model
file is given, one fitted to the slowest records only, and the joint fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.data.dataset import Dataset, beginning_like, thinned
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
    fitted_to,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.revision import (
    RecordAssumptions,
    estimate_nuisances,
)
from piezo_hysteresis.identification.initial_conditions.start_hypotheses import (
    InitialConditionSelector,
)
from piezo_hysteresis.identification.output_error import output_error, suited
from piezo_hysteresis.identification.starts import representative, starts
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.records import Record

SLOWEST = 3
START_SAMPLES = 60_000
EVALUATIONS = 60
_REVISIONS = 3  # of the initial conditions by a fit
TOLERANCE = 1e-7  # a tenth of that of later fits: all improvements refer to this fit


@dataclass(frozen=True)
class Baselines:
    """Versions of the baseline.

    Attributes
    ----------
    joint : CandidateFit
        Fitted to all training views.
    slow : CandidateFit or None
        Fitted to the slowest views and evaluated on all.
    nominal : CandidateFit or None
        With the values of its file, evaluated on all views.
    """

    joint: CandidateFit
    slow: CandidateFit | None
    nominal: CandidateFit | None


def fitted_baselines(
    data: Dataset,
    given: Model | ModelFile,
    choices: RecordAssumptions,
    workers: int = 1,
    deadline: Deadline | None = None,
) -> tuple[Baselines, Dataset]:
    """Fit baseline and initial conditions of the records alternately until they converge."""
    end = deadline or Deadline()
    model = given.model if isinstance(given, ModelFile) else suited(given, list(data.records))
    specs = _from_data(data, model, choices, workers, end)
    nominal = None
    if isinstance(given, ModelFile):
        nominal = ModelSpec(model, dict(given.values))
        specs = [nominal, *specs]
    found: list[tuple[CandidateFit, Dataset]] = []
    for spec in specs:
        if found and end.skips('a further start of the baseline'):
            break
        fit = _first_fit(spec, data, choices, workers, end)
        if fit is not None:
            found.append(fit)
    if not found:
        raise IdentificationError(
            f'the baseline {model.name} cannot be fitted to these records: choose another one'
        )
    best = min(found, key=lambda each: each[0].floors)
    joint, seen = _converged(*best, data, choices, workers, end)
    views = seen.training
    as_given = None if nominal is None else evaluated_on(nominal, views)
    return Baselines(joint, _slow(joint, views, workers, end), as_given), seen


def _first_fit(
    spec: ModelSpec, data: Dataset, choices: RecordAssumptions, workers: int, end: Deadline
) -> tuple[CandidateFit, Dataset] | None:
    """Return a fit to part of the samples, with initial conditions estimated by `spec`."""
    seen = with_revised_starts(spec, data, choices, workers)
    fit = _fitted(spec, thinned(seen.training, START_SAMPLES, data.periods), workers, end)
    return None if fit is None else (fit, seen)


def _converged(
    fit: CandidateFit,
    seen: Dataset,
    data: Dataset,
    choices: RecordAssumptions,
    workers: int,
    end: Deadline,
) -> tuple[CandidateFit, Dataset]:
    """Return the converged fit to all samples and the data with its initial conditions."""
    fit = _fitted(fit, seen.training, workers, end) or evaluated_on(fit, seen.training)
    for _ in range(_REVISIONS):
        if end.passed:
            break
        renewed = with_revised_starts(fit, data, choices, workers)
        if same_initial_conditions(seen, renewed):
            break
        seen = renewed
        fit = _fitted(fit, seen.training, workers, end) or evaluated_on(fit, seen.training)
    return fit, seen


def first_values(joint: ModelSpec, data: Dataset, samples: int) -> dict[str, float]:
    """Return the parameter values of a baseline from a scan of starting values, before any fit."""
    model = joint.model
    short = thinned(data.training, samples, data.periods)
    views = [replace(view, own_zero=True) for view in representative(short)]
    held = {name: joint.values[name] for name in model.held}
    offsets = (joint.sampling_offset,)
    found = starts(model, views, model.free_names, held, count=1, offsets=offsets)
    return {name: found[0].values[name] for name in joint.values}


def same_initial_conditions(one: Dataset, other: Dataset) -> bool:
    """Return whether initial conditions and zero offsets of two datasets are equal."""
    return all(map(FitData.begins_like, one.training, other.training))


def _slow(
    joint: CandidateFit, views: Sequence[FitData], workers: int, end: Deadline
) -> CandidateFit | None:
    slowest = _slowest(views)
    if len(slowest) == len(views) or end.skips('the baseline on the slowest records'):
        return None
    fit = _fitted(joint, slowest, workers, end)
    return None if fit is None else evaluated_on(ModelSpec(joint.model, fit.values), views)


def with_revised_starts(
    spec: ModelSpec,
    data: Dataset,
    choices: RecordAssumptions,
    workers: int,
    *,
    alone: bool = False,
) -> Dataset:
    """Return the data with initial conditions, zero offsets and weights by a model."""
    names = {v.name for v in data.training}
    views = [*data.training, *(v for v in data.held_out if v.name not in names)]
    renewed = estimate_nuisances(
        spec.model,
        spec.values,
        spec.sampling_offset,
        views,
        data.records,
        choices,
        alone=alone,
        workers=workers,
    )
    return beginning_like(data, renewed)


def _from_data(
    data: Dataset, model: Model, choices: RecordAssumptions, workers: int, end: Deadline
) -> list[ModelSpec]:
    """Return starting values from output-error fits to all training records and to the slowest."""
    known = {r.name: r for r in data.records}
    records = [known[view.name].section(0, view.voltage.size - view.origin)
               for view in data.training]  # fmt: skip
    slow, starts = _slow_records(records), list[ModelSpec]()
    for chosen in (records, slow) if len(slow) < len(records) else (records,):
        if starts and end.skips('starts from the slowest records'):
            break
        try:
            result = output_error(
                model, chosen,
                begins=choices.start, zero=choices.zero, workers=workers,
                stopped=lambda: end.passed,
            )  # fmt: skip
        except IdentificationError:
            continue
        offset = result.sampling_offset
        starts.append(ModelSpec(model, dict(result.values), sampling_offset=offset))
    return starts


def _slow_records(records: Sequence[Record]) -> list[Record]:
    driven = [r for r in records if r.info.frequency > 0]
    return sorted(driven, key=lambda r: r.info.frequency)[:SLOWEST] or list(records)


def _slowest(views: Sequence[FitData]) -> tuple[FitData, ...]:
    driven = [v for v in views if v.frequency > 0]
    return tuple(sorted(driven, key=lambda v: v.frequency)[:SLOWEST]) or tuple(views)


def _fitted(
    spec: ModelSpec, views: Sequence[FitData], workers: int, end: Deadline
) -> CandidateFit | None:
    return fitted_to(
        spec,
        views,
        evaluations=EVALUATIONS,
        tolerance=TOLERANCE,
        stopped=lambda: end.passed,
        workers=workers,
    )


def with_renewed_starts(
    fit: CandidateFit, data: Dataset, choices: RecordAssumptions, workers: int
) -> Dataset:
    """Return the data with initial conditions and zero offsets estimated by a model.

    The weights stay, so that sums of squares remain comparable.
    """
    return _as_weighted(data, with_revised_starts(fit, data, choices, workers))


def with_other_starts(
    fit: CandidateFit, data: Dataset, choices: RecordAssumptions
) -> list[tuple[Dataset, float]]:
    """Return the data with starts at rest at 0 V or in motion, where the others could be such.

    An initial condition estimated without an effect imitates it, and the effect is then fitted to
    the remaining residual; from rest, the effect alone may explain the record. Conversely an
    effect fitted from rest adapts to that, although the record begins in motion. With each comes
    the sum of squares below which it is preferred, relative to that of the given fit.
    """
    search = InitialConditionSelector(
        fit.model, fit.values, fit.sampling_offset, data.records, choices.start
    )
    steps, motion = search.with_steps(data.training), search.in_motion(data.training)
    found = [(steps[0], 1.0)] if steps else []
    found += [motion] if motion else []
    return [(_as_weighted(data, beginning_like(data, seen)), most) for seen, most in found]


def _as_weighted(data: Dataset, renewed: Dataset) -> Dataset:
    weights = {view.name: view.precision for view in (*data.training, *data.held_out)}
    return renewed.with_each(lambda view: replace(view, precision=weights[view.name]))
