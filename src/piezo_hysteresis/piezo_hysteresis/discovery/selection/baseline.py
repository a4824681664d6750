"""The model before anything is added: never the refitted one alone.

A refit hides an effect in wrong parameters, so three versions are kept: the nominal one where a
model file was given, one that saw the slowest records only, and the joint fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from piezo_hysteresis.discovery.data.dataset import Dataset, beginning_like, thinned
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    fitted_to,
    judged_on,
)
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.circumstances import Choices, revised
from piezo_hysteresis.identification.output_error import output_error, suited
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.records import Record

SLOWEST = 3
START_SAMPLES = 60_000
EVALUATIONS = 60
TOLERANCE = 1e-7  # a tenth of that of later fits: every gain is counted from here


@dataclass(frozen=True)
class Baselines:
    """The versions of the model that lacks something.

    Attributes
    ----------
    joint : CandidateFit
        Fitted to all training views.
    slow : CandidateFit or None
        Fitted to the slowest ones, judged on all.
    nominal : CandidateFit or None
        As it was given, judged on all.
    """

    joint: CandidateFit
    slow: CandidateFit | None
    nominal: CandidateFit | None


def baselines(data: Dataset, given: Model | ModelFile, workers: int = 1) -> Baselines:
    """Fit the baseline in its versions, with so many threads.

    Raises
    ------
    IdentificationError
        If it cannot be fitted to the records at all.
    """
    views = data.training
    nominal, slow = None, None
    if isinstance(given, ModelFile):
        model, values = given.model, dict(given.values)
        nominal = judged_on(ModelSpec(model, values), views)
        starts = [values, *_from_data(data, suited(model, list(data.records)), workers)]
    else:
        model = suited(given, list(data.records))
        starts = _from_data(data, model, workers)
    short = thinned(views, START_SAMPLES, data.periods)
    tried = [_fitted(model, start, short, workers) for start in starts]
    found = [fit for fit in tried if fit is not None]
    if not found:
        raise IdentificationError(
            f'the baseline {model.name} cannot be fitted to these records: choose another one'
        )
    best = min(found, key=lambda fit: fit.square)
    joint = _fitted(model, best.values, views, workers) or best
    slowest = _slowest(views)
    if len(slowest) < len(views):
        fit = _fitted(model, best.values, slowest, workers)
        slow = judged_on(ModelSpec(model, fit.values), views) if fit is not None else None
    return Baselines(joint, slow, nominal)


def fitted_baselines(
    data: Dataset, given: Model | ModelFile, choices: Choices, workers: int = 1
) -> tuple[Baselines, Dataset]:
    """Fit the baseline, and let it tell how each record began before it is fitted again.

    Returns
    -------
    baselines : Baselines
        The versions of the model.
    data : Dataset
        With starts, zeros and weights of the records as the joint fit tells them.

    Raises
    ------
    IdentificationError
        If the model cannot be fitted to the records at all.
    """
    base = baselines(data, given, workers)
    seen = told_by(base.joint, data, choices)
    if all(a.begins == b.begins and a.own_zero == b.own_zero for a, b in _pairs(data, seen)):
        return base, seen
    return baselines(seen, given, workers), seen


def _pairs(one: Dataset, other: Dataset) -> Iterator[tuple[Target, Target]]:
    return zip((*one.training, *one.held_out), (*other.training, *other.held_out), strict=True)


def told_by(spec: ModelSpec, data: Dataset, choices: Choices, *, alone: bool = False) -> Dataset:
    """Return the data with starts, zeros and weights as a model tells them, see `revised`."""
    names = {v.name for v in data.training}
    views = [*data.training, *(v for v in data.held_out if v.name not in names)]
    renewed = revised(
        spec.model,
        spec.values,
        spec.sampling_offset,
        views,
        data.records,
        choices,
        alone=alone,
    )
    return beginning_like(data, renewed)


def _from_data(data: Dataset, model: Model, workers: int) -> list[dict[str, float]]:
    """Start values from output error on the training records, jointly and on the slowest."""
    names = {v.name for v in data.training}
    records = [r for r in data.records if r.name in names]
    starts = []
    for chosen in (records, _slow_records(records)):
        try:
            result = output_error(model, chosen, count=4, sampling_offset=False, workers=workers)
        except IdentificationError:
            continue
        starts.append(dict(result.values))
    return starts


def _slow_records(records: Sequence[Record]) -> list[Record]:
    driven = [r for r in records if r.info.frequency > 0]
    return sorted(driven, key=lambda r: r.info.frequency)[:SLOWEST] or list(records)


def _slowest(views: Sequence[Target]) -> tuple[Target, ...]:
    driven = [v for v in views if v.frequency > 0]
    return tuple(sorted(driven, key=lambda v: v.frequency)[:SLOWEST]) or tuple(views)


def _fitted(
    model: Model, start: Mapping[str, float], views: Sequence[Target], workers: int
) -> CandidateFit | None:
    spec = ModelSpec(model, dict(start))
    return fitted_to(spec, views, evaluations=EVALUATIONS, tolerance=TOLERANCE, workers=workers)
