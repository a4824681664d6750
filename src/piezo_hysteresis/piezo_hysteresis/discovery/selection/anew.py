"""What was settled before an effect was known, settled again knowing it.

A baseline that is fitted alone hides what it lacks in a loop of another shape, or in other ways in
which the records began. With the effect it would not go there, but no fit comes back from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection.baseline import told_by
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    errors_of,
    judged_on,
)
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.starts import other_loops
from piezo_hysteresis.identification.targets import Target


def by_other_loops(evaluator: Evaluator, fit: CandidateFit, start: CandidateFit) -> CandidateFit:
    """Return a model with effects fitted from loops of other shapes, itself if none is better.

    What the effects do is taken off the records, so that the loops are looked for with the
    baseline alone, `start`, which is quick, and whose gains follow exactly.
    """
    views, judged = evaluator.short, judged_on(fit, evaluator.short)
    best = before = judged.square
    evaluations, workers = evaluator.policy.first_evaluations, evaluator.workers
    for values in _loops(fit, judged, start, views):
        spec = replace(fit, values=fit.values | values)
        brief = evaluator.fit_briefly(spec, evaluations, best, workers)
        if brief is not None and brief.square < best:
            best, judged = brief.square, brief
    fit = evaluator.judged(fit)
    if best >= (1.0 - evaluator.policy.better) * before:
        return fit
    ended = evaluator.fit(judged)
    return fit if ended is None or ended.square > fit.square else ended


def _loops(
    fit: CandidateFit, judged: CandidateFit, start: CandidateFit, views: Sequence[Target]
) -> list[dict[str, float]]:
    """Return other values of the baseline's parameters, by the records without the effects."""
    free = set(start.model.free_names) & set(fit.model.free_names)
    known = start.values | {k: v for k, v in fit.values.items() if k in free}
    bare = errors_of(ModelSpec(start.model, known, (), fit.sampling_offset), views)
    cleared = [
        replace(view, measured=view.measured - (without - withal))
        for view, without, withal in zip(views, bare, judged.errors, strict=True)
    ]
    found = other_loops(start.model, cleared, known)
    return [{k: v for k, v in each.values.items() if k in free} for each in found]


def with_own_zeros(data: Dataset) -> Dataset:
    """Return the data with a zero of its own for every record."""

    def own(views: Sequence[Target]) -> tuple[Target, ...]:
        return tuple(replace(view, own_zero=True) for view in views)

    return replace(data, training=own(data.training), held_out=own(data.held_out))


def told_again(fit: CandidateFit, data: Dataset, choices: Choices) -> Dataset:
    """Return the data with starts and zeros of the records as a model tells them.

    Weights stay, so that sums of squares can be compared.
    """
    renewed = told_by(fit, data, choices)

    def weighed(views: Sequence[Target], old: Sequence[Target]) -> tuple[Target, ...]:
        return tuple(replace(v, precision=w.precision) for v, w in zip(views, old, strict=True))

    return replace(
        renewed,
        training=weighed(renewed.training, data.training),
        held_out=weighed(renewed.held_out, data.held_out),
    )
