"""Candidates of a selection round."""

from __future__ import annotations

from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.models import Candidate, described


def refined_candidates(evaluator: Evaluator, before: ModelSpec) -> tuple[Candidate, ...]:
    """Return the model extended by each candidate, without simpler variants of its effects."""
    return tuple(each for each in evaluator.candidates(before) if not _is_had(each, before))


def _is_had(candidate: Candidate, before: ModelSpec) -> bool:
    """Return whether the model already has a refined variant of the candidate."""
    block = candidate.effect.block
    own = {q.name for q in block.parameters} if block is not None else set()
    return any(
        effect.refines and set(effect.refines.values()) <= own
        for added in before.added
        if added.effect == candidate.effect.name
        for effect in described(added.effect)
        if effect.variant == added.variant
    )
