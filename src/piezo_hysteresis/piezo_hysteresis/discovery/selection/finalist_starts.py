"""Comparison of the finalists of a round, each with its own estimated initial conditions.

The initial conditions were estimated by an incomplete model. A delay before a step resembles a
motion from before the record, and with such an initial condition a lag explains more than the
delay. A finalist is therefore accepted only after each of them has estimated its own initial
conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.rounds import SelectionRound, ranked


def led_by_best_start(
    evaluator: Evaluator, round_: SelectionRound, start: CandidateFit
) -> tuple[Evaluator, SelectionRound]:
    """Return the round with the finalist first that is best with its own initial conditions.

    This is needed only if the initial conditions can change; otherwise they can hide no effect.
    """
    if not evaluator.starts_may_differ(round_.best):
        return evaluator, round_
    if evaluator.deadline.skips('initial conditions of the alternatives'):
        return evaluator, round_
    chosen, first, fits = evaluator, round_.best, list(round_.finalists)
    best_of_each = {fit.effect: fit for fit in reversed(round_.finalists)}
    for fit in best_of_each.values():
        other, again = evaluator.with_own_starts(fit)
        if other.score(again) >= evaluator.score(fit) - evaluator.policy.better:
            continue
        # the model without the effect may have its own initial conditions, too
        before = min(round_.before, other.evaluated(round_.before), key=other.score)
        wins = (
            other.score(again) < chosen.score(first) - evaluator.policy.better
            and other.explains_enough(before, again, start)
            and other.is_significant(before, again, round_.tried)
        )
        if fit is first and not wins:
            continue
        fits[next(k for k, each in enumerate(fits) if each is fit)] = again
        if wins:
            chosen, first = other, again
    if all(fit is before for fit, before in zip(fits, round_.finalists, strict=True)):
        return evaluator, round_
    return chosen, _led(chosen, round_, first, fits, accepted=chosen is not evaluator)


def _led(
    chosen: Evaluator,
    round_: SelectionRound,
    first: CandidateFit,
    fits: Sequence[CandidateFit],
    *,
    accepted: bool,
) -> SelectionRound:
    """Return the round with `first` in the lead of the finalists, each with its own starts."""
    order = (first, *ranked(chosen, [fit for fit in fits if fit is not first]))
    return replace(
        round_,
        accepted=round_.accepted or accepted,
        finalists=order,
        shares=chosen.shares(round_.before, order),
        gain=chosen.improvement(round_.before, first, round_.tried),
    )
