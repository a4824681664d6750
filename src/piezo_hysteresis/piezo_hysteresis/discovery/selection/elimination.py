"""Backward elimination of effects that were added one at a time.

The first effect was selected while the others were still in the residual. Each effect is therefore
removed and its position is selected again. A redundant effect is removed, an effect that only
resembled the sum of others is replaced, and the effects that stay are significant in the presence
of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from piezo_hysteresis.discovery.selection.candidate_fit import Added, CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.rounds import SelectionRound, select

# Probability below which an effect is not listed by a search that its time limit ended.
_UNLIKELY = 0.005
# Relative distance from an end of its range at which a parameter counts as limited by it.
_AT_BOUND = 1e-3


@dataclass(frozen=True)
class Step:
    """One accepted effect.

    Attributes
    ----------
    round : SelectionRound
        The round that accepted it, with the other effects in the model.
    fit : CandidateFit
        The model with the effect.
    """

    round: SelectionRound
    fit: CandidateFit


def retested(
    evaluator: Evaluator, start: CandidateFit, steps: Sequence[Step]
) -> tuple[Evaluator, list[Step], CandidateFit]:
    """Test every effect again until the model does not change.

    The initial conditions were estimated with effects missing or replaced by others: a delay
    before a step resembles a motion from before the record, and a lag then fits better than the
    delay. A simpler model is therefore also evaluated with initial conditions that it estimates
    itself.
    """
    kept, final = list(steps), steps[-1].fit
    done: set[str] = set()
    for _ in range(evaluator.policy.elimination_rounds * len(steps)):
        names = list(dict.fromkeys(added.effect for added in final.added))
        # the last effect was selected with all others in the model
        name = next((each for each in names[:-1] if each not in done), None)
        if name is None:
            break
        done.add(name)
        clear = any(
            step.fit.effect == name and step.round.won_clearly(evaluator.policy) for step in kept
        )
        without = without_effect(evaluator, final, start, name, compared=clear)
        if without is None:
            continue
        chosen, bare = evaluator, without
        if not evaluator.is_as_good(without, final):
            chosen, bare = evaluator.with_own_starts(without)
        if chosen.is_as_good(bare, final):
            evaluator, kept, final, done = chosen, _less(kept, name), bare, set()
            continue
        if clear:
            continue
        again = _selected_again(evaluator, without, final, start, name)
        if again is None:
            continue
        if evaluator.score(again.best) < evaluator.score(final) - evaluator.policy.better:
            final, done = again.best, {again.best.effect}
            kept = [*_less(kept, name), Step(again, final)]
        elif again.accepted and again.best.effect == name:
            here = next(k for k, step in enumerate(kept) if step.fit.effect == name)
            kept[here] = Step(again, again.best)
        elif not again.accepted and not evaluator.deadline.passed:
            # with the others present it would not have been added
            evaluator, kept, final, done = chosen, _less(kept, name), bare, set()
    return evaluator, kept, final


def without_unfinished(
    evaluator: Evaluator, start: CandidateFit, steps: Sequence[Step], final: CandidateFit
) -> tuple[list[Step], CandidateFit]:
    """Remove the effects that a search ended by its time limit has not settled.

    Such an effect has hardly any probability, is not significant against a fit that may not have
    ended, has parameters at the end of their range, or leaves clearly more than a rival.
    """
    kept = list(steps)
    for step in steps:
        name = step.fit.effect
        likely = step.round.probabilities()[name] >= _UNLIKELY
        sure = step.round.gain.p_value < evaluator.policy.chance
        leads = not step.round.lost_clearly(evaluator.policy)
        if likely and sure and leads and not _ends_at_a_bound(final, name):
            continue
        bare = without_effect(evaluator, final, start, name)
        if bare is None:
            continue
        kept, final = _less(kept, name), bare
    return kept, final


def _ends_at_a_bound(fit: CandidateFit, name: str) -> bool:
    """Return whether a fitted parameter of an effect is at an end of its range."""
    own = {each for added in fit.added if added.effect == name for each in added.names.values()}
    return any(
        abs(fit.values[q.name] - end) <= _AT_BOUND * abs(end)
        for q in fit.model.parameters
        if q.name in own and not q.held
        for end in (q.low, q.high)
    )


def pruned(evaluator: Evaluator, final: CandidateFit, start: CandidateFit) -> CandidateFit:
    """Return `final` without redundant effects, or itself if there are none.

    The fit of a new effect may improve the values of earlier effects until the new one is
    redundant. Only in that case is the removal of every effect tested.
    """
    idle = _with_only(evaluator, final, start, final.added[:-1])
    limit = (1.0 + evaluator.policy.idle) * final.square
    if idle is None or evaluator.evaluated(idle).square > limit:
        return final
    for place in reversed(range(len(final.added))):
        kept = [*final.added[:place], *final.added[place + 1 :]]
        bare = _with_only(evaluator, final, start, kept) if kept else None
        fitted = None if bare is None else evaluator.fit(bare)
        if fitted is not None and evaluator.is_as_good(fitted, final):
            final = fitted
    return final


def _less(steps: Sequence[Step], name: str) -> list[Step]:
    return [step for step in steps if step.fit.effect != name]


def _selected_again(
    evaluator: Evaluator,
    without: CandidateFit,
    final: CandidateFit,
    start: CandidateFit,
    name: str,
) -> SelectionRound | None:
    """Run a selection round for the position of an effect; one with several elements keeps it."""
    if sum(added.effect == name for added in final.added) > 1:
        return None
    return select(evaluator, without, start, lambda fraction, message: None)


def without_effect(
    evaluator: Evaluator,
    final: CandidateFit,
    start: CandidateFit,
    name: str,
    *,
    compared: bool = False,
) -> CandidateFit | None:
    """Return the model without an effect, fitted from the values of `final`.

    With `compared`, the fit is terminated early if it cannot reach the quality of `final`.
    """
    kept = [added for added in final.added if added.effect != name]
    bare = _with_only(evaluator, final, start, kept)
    enough = evaluator.enough(final, evaluator.policy.alternative_within) if compared else inf
    return None if bare is None else evaluator.fit(bare, enough=enough)


def _with_only(
    evaluator: Evaluator, final: CandidateFit, start: CandidateFit, kept: Sequence[Added]
) -> ModelSpec | None:
    """Return `start` with some of the effects of `final`, with the values of `final`."""
    held = start.model.held  # the final model may have freed some of them
    found = {k: v for k, v in final.values.items() if k in start.values and k not in held}
    bare: ModelSpec | None = ModelSpec(
        start.model, start.values | found, (), final.sampling_offset
    )
    for added in kept:
        bare = None if bare is None else _again(evaluator, bare, added, final)
    return bare


def _again(
    evaluator: Evaluator, bare: ModelSpec, added: Added, final: CandidateFit
) -> ModelSpec | None:
    """Return `bare` with an effect of `final` added, with its values in `final`."""
    for each in evaluator.candidates(bare):
        if (each.effect.name, each.effect.variant) != (added.effect, added.variant):
            continue
        held = each.model.held
        known = {
            name: final.values[added.names[own]]
            for own, name in each.renamed.items()
            if name not in held
        }
        return bare.with_candidate(each, each.values(bare.values, {**each.neutral, **known}))
    return None
