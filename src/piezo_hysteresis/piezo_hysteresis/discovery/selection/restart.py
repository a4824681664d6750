"""First fits that begin where the baseline did, not where it ended.

A baseline that is fitted alone ends where it hides most of what it lacks: with a loop of another
shape, or with the gains of two branches that nearly cancel. No fit comes back from there. Where
the scan for start values put it nothing is hidden yet, and the right effect gets on from there
together with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.screen import ScreeningScore


def better_of_both(
    evaluator: Evaluator,
    before: CandidateFit,
    chosen: Sequence[ScreeningScore],
    fitted: Sequence[CandidateFit],
) -> list[CandidateFit]:
    """Return first fits, each from the baseline's first values where these led farther.

    Only for the first effect: with one the baseline was fitted together. Nor where it is held.

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
    needless = before.added or not chosen or evaluator.deadline.passed
    values = None if needless else evaluator.first_values(before)
    if values is None:
        return list(fitted)
    enough = evaluator.enough(fitted[0], evaluator.policy.final_within) if fitted else inf

    def again(score: ScreeningScore) -> CandidateFit | None:
        candidate = score.candidate
        if evaluator.deadline.skips(candidate.effect.name):
            return None
        own = {name: score.starts[0][name] for name in candidate.added}
        initial = {**score.starts[0], **candidate.values({**before.values, **values}, own)}
        spec = before.with_candidate(candidate, initial)
        # from far off no first step promises what the whole way brings
        near = evaluator.fit_briefly(spec, evaluator.policy.first_evaluations)
        if near is None:
            return None
        fit = evaluator.fit_briefly(near, evaluator.policy.afresh_evaluations, enough)
        return evaluator.first_judged(fit or near)

    best = {(fit.effect, fit.variant): fit for fit in fitted}
    for fit in evaluator.map(again, chosen):
        if fit is None:
            continue
        known = best.get((fit.effect, fit.variant))
        if known is None or fit.square < known.square:
            best[fit.effect, fit.variant] = fit
    return list(best.values())
