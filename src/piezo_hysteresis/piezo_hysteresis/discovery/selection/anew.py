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
    baseline alone, `start`, which is quick, and whose gains follow exactly. All are fitted to
    short views first, and so is the model from where it is: a loop must lead to less than that.

    Parameters
    ----------
    evaluator : Evaluator
        Fits and scores.
    fit, start : CandidateFit
        The model, and the baseline.
    """
    evaluations, workers = evaluator.policy.first_evaluations, evaluator.workers
    here = evaluator.fit_briefly(fit, evaluations, workers=workers)
    best = here = here or judged_on(fit, evaluator.short)
    for values in _loops(here, start, evaluator.short):
        spec = replace(here, values=here.values | values)
        brief = evaluator.fit_briefly(spec, evaluations, best.square, workers)
        if brief is not None and brief.square < best.square:
            best = brief
    judged = evaluator.judged(fit)
    if best.square > (1.0 - evaluator.policy.better) * here.square:
        return judged
    ended = evaluator.fit(best)
    return judged if ended is None or ended.square > judged.square else ended


def _loops(
    fit: CandidateFit, start: CandidateFit, views: Sequence[Target]
) -> list[dict[str, float]]:
    """Return other values of the baseline's parameters, by the records without the effects.

    The model was fitted to these views.
    """
    free = set(start.model.free_names) & set(fit.model.free_names)
    known = start.values | {k: v for k, v in fit.values.items() if k in free}
    bare = errors_of(ModelSpec(start.model, known, (), fit.sampling_offset), views)
    cleared = [
        replace(view, measured=view.measured - (without - withal))
        for view, without, withal in zip(views, bare, fit.errors, strict=True)
    ]
    found = other_loops(start.model, cleared, known)
    return [{k: v for k, v in each.values.items() if k in free} for each in found]


def told_again(fit: CandidateFit, data: Dataset, choices: Choices, workers: int) -> Dataset:
    """Return the data with starts and zeros of the records as a model tells them.

    Weights stay, so that sums of squares can be compared.
    """
    weights = {view.name: view.precision for view in (*data.training, *data.held_out)}
    renewed = told_by(fit, data, choices, workers)
    return renewed.with_each(lambda view: replace(view, precision=weights[view.name]))
