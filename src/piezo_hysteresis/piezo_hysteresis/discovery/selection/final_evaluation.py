"""Evaluation of the result of a search on held-out views."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, evaluated_on
from piezo_hysteresis.discovery.selection.evaluator import Remainder
from piezo_hysteresis.discovery.selection.search import Found


@dataclass(frozen=True)
class Outcome:
    """Data of a verdict."""

    found: Found  # result of the search
    before: CandidateFit
    after: CandidateFit
    remainder: Remainder  # residual of the final model
    certainty: float  # probability that the missing effect is among the candidates [1]

    @property
    def ends_in_noise(self) -> bool:
        """Whether the final residual on held-out records is close to the noise."""
        return self.after.floors <= self.found.evaluator.policy.explained_gap


def with_headlines_only(found: Found) -> Found:
    """Return the result of a search without effects that reduce the gap too little.

    The known discrepancy of a fixed baseline is not part of the gap: no effect can remove it.
    """
    if not found.steps:
        return found
    if found.evaluator.reduces_gap(found.start, found.final):
        return found
    last = found.last or found.steps[-1].round
    return replace(found, steps=(), final=found.start, last=last)


def outcome_of(found: Found) -> Outcome:
    """Return the result of a search, evaluated on held-out records."""
    found = with_headlines_only(found)
    evaluator, views = found.evaluator, found.evaluator.measured.held_out
    before = evaluated_on(found.start, views)
    after = evaluated_on(found.final, views) if found.steps else before
    remainder = evaluator.remainder(found.final, found.start)
    start, final = evaluator.as_measured(found.start), evaluator.as_measured(found.final)
    return Outcome(
        replace(found, start=start, final=final),
        before,
        after,
        remainder,
        evaluator.certainty(before.floors, after.floors),
    )


def without_names(outcome: Outcome) -> Outcome:
    """Return an outcome whose effects are only what the residual resembles."""
    found = outcome.found
    if not found.steps:
        return outcome
    last = found.last or found.steps[-1].round
    found = replace(found, steps=(), final=found.start, last=last)
    left = found.evaluator.remainder(found.final, found.start)
    return replace(
        outcome, found=found, after=outcome.before, remainder=replace(left, significant=True)
    )
