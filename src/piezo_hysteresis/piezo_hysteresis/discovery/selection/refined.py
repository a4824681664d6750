"""Richer ways of an effect, tried once the plain one leads and leaves something.

A curve of third order costs two parameters and tells most sensors; a spline tells any and costs
six. So the spline is not screened beside it: it begins where the cubic ended, and is taken for
what it explains besides if that would be worth the name of an effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.screen import Screen
from piezo_hysteresis.models import Candidate, described


def competing(evaluator: Evaluator, before: ModelSpec) -> tuple[Candidate, ...]:
    """Return what competes: no richer way of anything, nor a plainer one of what is there."""
    every = evaluator.candidates(before)
    return tuple(each for each in every if not each.effect.refines and not _is_had(each, before))


def richer(
    evaluator: Evaluator,
    before: CandidateFit,
    leader: CandidateFit,
    start: CandidateFit,
    tried: int,
) -> list[CandidateFit]:
    """Return the fits of richer ways of the leading effect that are worth what they cost.

    One that promises too little where the plain way ended is not fitted.

    Parameters
    ----------
    evaluator : Evaluator
        Fits and judges.
    before, leader, start : CandidateFit
        The model without the effect, the one with its plain way, and the baseline.
    tried : int
        Candidates that were looked at.
    """
    if not evaluator.lacks_something(leader, start):
        return []
    least = rules.least_promise(evaluator.excess(leader), evaluator.policy)
    found = []
    for each, spec in _begun(evaluator, before, leader):
        screen = Screen(leader, evaluator.screened, evaluator.free_of(leader), evaluator.workers)
        if screen.nearby(each, spec.values) <= least:
            continue
        if evaluator.deadline.skips(spec.variant):
            break
        fit = evaluator.fit(spec)
        if (
            fit is not None
            and evaluator.stays_finite(fit)
            and evaluator.is_worthy(leader, fit, start)
            and evaluator.is_sure(leader, fit, tried)
        ):
            found.append(fit)
    return found


def _begun(
    evaluator: Evaluator, before: CandidateFit, leader: CandidateFit
) -> Iterator[tuple[Candidate, ModelSpec]]:
    """Yield richer ways of what came last in `leader`, and the models with which they begin."""
    plain = leader.added[-1]
    for each in evaluator.candidates(before):
        refines = each.effect.refines
        if each.effect.name != plain.effect or not refines:
            continue
        if not set(refines.values()) <= set(plain.names):
            continue
        known = {
            each.renamed[own]: leader.values[plain.names[other]] for own, other in refines.items()
        }
        spec = before.with_candidate(each, each.values(leader.values, {**each.neutral, **known}))
        yield each, replace(spec, sampling_offset=leader.sampling_offset)


def _is_had(candidate: Candidate, before: ModelSpec) -> bool:
    """Return whether a model has a richer way of a candidate already."""
    block = candidate.effect.block
    own = {q.name for q in block.parameters} if block is not None else set()
    return any(
        effect.refines and set(effect.refines.values()) <= own
        for added in before.added
        if added.effect == candidate.effect.name
        for effect in described(added.effect)
        if effect.variant == added.variant
    )
