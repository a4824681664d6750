"""First fits that begin where the baseline did, not where it ended.

A baseline that is fitted alone ends where it hides most of what it lacks: with a loop of another
shape, or with the gains of two branches that nearly cancel. No fit comes back from there. Where
the scan for start values put it nothing is hidden yet, and the right effect gets on from there
together with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from piezo_hysteresis.discovery.data.dataset import Dataset, thinned
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.screen import ScreeningScore
from piezo_hysteresis.identification.starts import representative, starts


def first_values(joint: ModelSpec, data: Dataset, samples: int) -> dict[str, float]:
    """Return the values of a baseline before any fit, by a scan of some samples.

    Parameters
    ----------
    joint : ModelSpec
        The baseline; what its model holds stays.
    data : Dataset
        With starts of the records as the baseline tells them.
    samples : int
        As many of the training views.
    """
    model = joint.model
    short = thinned(data.training, samples, data.periods)
    views = [replace(view, own_zero=True) for view in representative(short)]
    held = {name: joint.values[name] for name in model.held}
    found = starts(model, views, model.free_names, held, count=1)
    return {name: found[0].values[name] for name in joint.values}


def better_of_both(
    evaluator: Evaluator,
    before: CandidateFit,
    chosen: Sequence[ScreeningScore],
    fitted: Sequence[CandidateFit],
) -> list[CandidateFit]:
    """Return first fits, each from the baseline's first values where these led farther.

    Only for the first effect: with one the baseline was fitted together.

    Parameters
    ----------
    evaluator : Evaluator
        Fits, and knows the baseline's first values.
    before : CandidateFit
        The model that lacks something.
    chosen : sequence of ScreeningScore
        What was tried.
    fitted : sequence of CandidateFit
        First fits from where `before` is, the best first.
    """
    best = {(fit.effect, fit.variant): fit for fit in fitted}
    if before.added:
        return list(best.values())
    enough = evaluator.enough(fitted[0], evaluator.policy.final_within) if fitted else 0.0

    def again(pair: tuple[ScreeningScore, Mapping[str, float]]) -> CandidateFit | None:
        score, values = pair
        if evaluator.deadline.skips(score.candidate.effect.name):
            return None
        own = {name: score.starts[0][name] for name in score.candidate.added}
        known = {**before.values, **values}
        spec = before.with_candidate(
            score.candidate, {**score.starts[0], **score.candidate.values(known, own)}
        )
        # from far off no first step promises what the whole way brings
        near = evaluator.fit_briefly(spec, evaluator.policy.first_evaluations)
        if near is None:
            return None
        fit = evaluator.fit_briefly(near, evaluator.policy.afresh_evaluations, enough)
        return evaluator.first_judged(fit or near)

    pairs = [(score, values) for score in chosen for values in evaluator.hints]
    for fit in evaluator.map(again, pairs):
        if fit is None:
            continue
        known = best.get((fit.effect, fit.variant))
        if known is None or fit.square < known.square:
            best[fit.effect, fit.variant] = fit
    return list(best.values())
