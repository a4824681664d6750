"""What a search came to, judged on the views that decided nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.selection import rules
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

    @property
    def ends_in_noise(self) -> bool:
        """Whether held-out records show hardly more than their noise in the end."""
        return self.after.floors <= self.found.evaluator.policy.explained_gap


def with_headlines_only(found: Found) -> Found:
    """Return the end of a search, without names that take too little of the held-out gap.

    What the baseline is known to miss in phase with the drive is no part of that gap.
    """
    if not found.steps:
        return found
    views = found.evaluator.data.held_out
    gaps = [judged_on(each, views).floors for each in (found.start, found.final)]
    if rules.takes_its_share(gaps[0], gaps[1], found.evaluator.policy):
        return found
    last = found.last or found.steps[-1].round
    return replace(found, steps=(), final=found.start, last=last)


def outcome_of(found: Found) -> Outcome:
    """Return the end of a search as it is on records that it has not seen."""
    found = with_headlines_only(found)
    evaluator, views = found.evaluator, found.evaluator.measured.held_out
    before = judged_on(found.start, views)
    after = judged_on(found.final, views) if found.steps else before
    remainder = evaluator.remainder(found.final, found.start)
    start, final = evaluator.as_measured(found.start), evaluator.as_measured(found.final)
    return Outcome(
        replace(found, start=start, final=final),
        before,
        after,
        remainder,
        evaluator.certainty(before.floors, after.floors),
    )
