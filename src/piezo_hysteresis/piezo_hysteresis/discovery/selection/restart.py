"""First fits from the initial parameter values of the baseline, before its fit.

A baseline that is fitted alone converges to a local minimum that hides most of the missing effect:
another loop shape, or two nearly cancelling gains. A fit with the effect does not leave this
minimum. The values from the scan of starting values hide nothing yet, and a joint fit with the
correct effect converges from there.
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
    """Return first fits, repeated from the initial values of the baseline if these fit better.

    This applies only to the first effect, because with an effect the baseline is fitted jointly.
    It does not apply to a fixed baseline.
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
        # far from the minimum the first steps do not predict the final result
        near = evaluator.fit_briefly(spec, evaluator.policy.first_evaluations)
        if near is None:
            return None
        fit = evaluator.fit_briefly(near, evaluator.policy.restart_evaluations, enough)
        return evaluator.sharpened(evaluator.evaluated_for_ranking(fit or near))

    best = {(fit.effect, fit.variant): fit for fit in fitted}
    for fit in evaluator.map(again, chosen):
        if fit is None:
            continue
        known = best.get((fit.effect, fit.variant))
        if known is None or fit.square < known.square:
            best[fit.effect, fit.variant] = fit
    return list(best.values())
