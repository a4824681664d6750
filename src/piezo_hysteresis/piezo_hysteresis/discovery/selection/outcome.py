"""What a search came to, judged on the views that decided nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, judged_on
from piezo_hysteresis.discovery.selection.evaluator import Remainder
from piezo_hysteresis.discovery.selection.search import Found


@dataclass(frozen=True)
class Outcome:
    """Everything that a verdict is made of.

    Attributes
    ----------
    found : Found
        The end of the search; the baseline alone where effects made it worse on held-out views.
    before, after : CandidateFit
        Its start and its end, judged on the held-out views.
    remainder : Remainder
        What is left in the end.
    certainty : float
        Probability that what is missing is among the effects that competed [1].
    """

    found: Found
    before: CandidateFit
    after: CandidateFit
    remainder: Remainder
    certainty: float


def outcome_of(found: Found) -> Outcome:
    """Return the end of a search without what is worse on records that it has not seen."""
    evaluator, views = found.evaluator, found.evaluator.measured.held_out
    before, after = judged_on(found.start, views), judged_on(found.final, views)
    if found.steps and not after.floors <= before.floors:
        found, after = replace(found, steps=(), final=found.start), before
    remainder = evaluator.remainder(found.final, found.start)
    start, final = evaluator.as_measured(found.start), evaluator.as_measured(found.final)
    return Outcome(
        replace(found, start=start, final=final),
        before,
        after,
        remainder,
        evaluator.certainty(before.floors, after.floors),
    )
