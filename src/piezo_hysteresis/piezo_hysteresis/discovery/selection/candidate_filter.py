"""What competes in a round."""

from __future__ import annotations

from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.models import Candidate, described


def competing(evaluator: Evaluator, before: ModelSpec) -> tuple[Candidate, ...]:
    """Return a model with every effect that it can take up, no plainer way of one that it has.

    Parameters
    ----------
    evaluator : Evaluator
        Knows which effects suit its view.
    before : ModelSpec
        The model.
    """
    return tuple(each for each in evaluator.candidates(before) if not _is_had(each, before))


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
