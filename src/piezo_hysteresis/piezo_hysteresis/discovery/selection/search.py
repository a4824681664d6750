"""Forward selection of effects, backward elimination, and restarts of the search."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, evaluated_on
from piezo_hysteresis.discovery.selection.elimination import (
    Step,
    pruned,
    retested,
    without_effect,
    without_unfinished,
)
from piezo_hysteresis.discovery.selection.evaluator import Evaluator, UnexplainedResidual
from piezo_hysteresis.discovery.selection.rounds import (
    Progress,
    SelectionRound,
    ranked,
    select,
    with_shares,
)


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
    fits = ranked(chosen, fits)
    enough = [chosen.explains_enough(round_.before, fit, start) for fit in fits]
    order, shares = with_shares(chosen, round_.before, first, fits, enough)
    gain = chosen.improvement(round_.before, first, round_.tried)
    accepted = round_.accepted or chosen is not evaluator
    return chosen, replace(round_, accepted=accepted, finalists=order, shares=shares, gain=gain)


@dataclass(frozen=True)
class SelectionResult:
    """Result of a search."""

    evaluator: Evaluator  # evaluator of the final model
    start: CandidateFit
    final: CandidateFit  # the model with all effects
    steps: tuple[Step, ...] = ()  # accepted effects
    last: SelectionRound | None = None  # the last round without an accepted effect

    @property
    def leaves_much(self) -> bool:
        """Whether the residual of the final model is far above the noise."""
        far = self.final.floors > self.evaluator.policy.explained_gap
        return far and self.evaluator.has_significant_residual(self.final, self.start)


def search(evaluator: Evaluator, start: CandidateFit, progress: Progress) -> SelectionResult:
    """Search the effects that `start` lacks.

    A second missing effect can cause a wrong effect to win the first round; the correct effect at
    the same position of the chain then cannot replace it. If a large residual remains, the search
    restarts with the next finalist of the first round, and the better result counts.
    """
    found = _forward(evaluator, start, [], progress)
    if not found.steps:
        return found
    first = found.steps[0].round
    progress(0.85, 'testing every effect with the others present')
    best = eliminated(found)
    for step in _others(evaluator, first):
        if not best.leaves_much or evaluator.deadline.skips(f'selection from {step.fit.effect}'):
            break
        progress(0.9, f'beginning again with {step.fit.effect}')
        again = replace(step, fit=_finished(evaluator, step.fit))
        seen = evaluator.with_tones_aligned(first.before)
        other = eliminated(_forward(seen, start, [again], lambda fraction, message: None))
        policy = evaluator.policy
        if other.evaluator.score(other.final) < best.evaluator.score(best.final) - policy.better:
            best = with_odds(other, again.round, best)
    return best


def with_odds(
    found: SelectionResult, restarted: SelectionRound, rival: SelectionResult
) -> SelectionResult:
    """Return the result of a restart, its first effect with its probability over the rival's.

    In the first round the effect was the less likely one; with the effects that followed, its
    model explains more than that of the rival, which may have it, too.
    """
    theirs = {added.effect for added in rival.final.added}
    wins = 1.0
    if restarted.best.effect not in theirs:
        wins = found.evaluator.shares(found.start, (found.final, rival.final))[0]
    weights = [float(fit.effect in theirs) for fit in restarted.finalists[1:]]
    rest = sum(weights) or 1.0
    odds = (wins, *((1.0 - wins) * weight / rest for weight in weights))
    steps = [
        replace(step, round=replace(step.round, shares=odds)) if step.round is restarted else step
        for step in found.steps
    ]
    return replace(found, steps=tuple(steps))


def eliminated(found: SelectionResult) -> SelectionResult:
    """Return the result without redundant effects, as far as the reserved time allows."""
    if found.evaluator.policy.elimination_rounds == 0 or not found.steps:
        return found
    evaluator, steps, final = found.evaluator.with_reserve(), list(found.steps), found.final
    several = len(steps) > 1
    if not (several and evaluator.deadline.skips('elimination of redundant effects')):
        evaluator, steps, final = retested(evaluator, found.start, steps)
    if evaluator.deadline.untried:
        steps, final = without_unfinished(evaluator, found.start, steps, final)
    last = found.last if steps else found.last or found.steps[-1].round
    return SelectionResult(evaluator, found.start, final, tuple(steps), last)


def _others(evaluator: Evaluator, first: SelectionRound) -> list[Step]:
    """Return alternative first effects: the close finalists of the first round."""
    found: list[Step] = []
    taken = {first.best.effect}
    share_of = dict(zip(map(id, first.finalists), first.shares, strict=True))
    for fit in first.finalists:
        if (
            fit.effect in taken
            or fit.square > evaluator.policy.alternative_within * first.best.square
        ):
            continue
        taken.add(fit.effect)
        order = (fit, *(each for each in first.finalists if each is not fit))
        round_ = replace(
            first,
            finalists=order,
            shares=tuple(share_of[id(each)] for each in order),
            gain=evaluator.improvement(first.before, fit, first.tried),
        )
        found.append(Step(round_, fit))
    return found[: evaluator.policy.restarts]


def _finished(evaluator: Evaluator, fit: CandidateFit) -> CandidateFit:
    """Return the fit continued until it converges."""
    thorough = 0 if evaluator.deadline.passed else evaluator.policy.thorough_evaluations
    return evaluator.refit(fit, thorough) if thorough else fit


def _forward(
    evaluator: Evaluator, start: CandidateFit, steps: list[Step], progress: Progress
) -> SelectionResult:
    """Add effects to those of `steps` one at a time until no significant residual remains."""
    current = steps[-1].fit if steps else start
    most = evaluator.policy.max_effects
    last: SelectionRound | None = None
    for place in range(len(steps), most):
        if not evaluator.has_significant_residual(current, start):
            return SelectionResult(evaluator, start, current, tuple(steps))
        if steps and evaluator.deadline.skips('a further effect'):
            return SelectionResult(evaluator, start, current, tuple(steps))
        evaluator = evaluator.with_tones_aligned(current)
        current = replace(evaluator.evaluated(current), fitted=current.fitted)
        begin, share = 0.12 + 0.7 * place / most, 0.7 / most

        def report(
            fraction: float, message: str, begin: float = begin, share: float = share
        ) -> None:
            progress(begin + share * fraction, message)

        last = select(evaluator, current, start, report)
        if last is not None:
            evaluator, last = led_by_best_start(evaluator, last, start)
        if last is None or not last.accepted:
            pair = None if steps or last is None else _pair(evaluator, start, last, progress)
            return pair or SelectionResult(evaluator, start, current, tuple(steps), last)
        current = _finished(evaluator, last.best)
        if evaluator.policy.elimination_rounds:
            current = pruned(evaluator, current, start)
        steps = steps_of(current, steps, last)
    return SelectionResult(evaluator, start, current, tuple(steps), last)


def _pair(
    evaluator: Evaluator, start: CandidateFit, last: SelectionRound, progress: Progress
) -> SelectionResult | None:
    """Return the model with two effects of which each hides the other, None if there is none.

    To a single effect the residual of the other is noise, and its fit may go astray to explain a
    part of that. Each first fit is therefore followed by a round with its effect in the model, and
    what that selects by a round without it. Two flexible effects also imitate one that no
    candidate has, so a pair counts only if it leaves no significant residual.
    """
    leads = last.leads if evaluator.policy.max_effects > 1 else ()
    for lead in leads[: evaluator.policy.restarts]:
        if evaluator.deadline.skips(f'pairs with {lead.effect}'):
            break
        progress(0.83, f'pairs with {lead.effect}')
        apart = evaluator.noting_apart()  # what these rounds skip was tried alone
        second = _round_of_pair(apart, last.before, apart.evaluated(lead), start)
        if second is not None:
            progress(0.84, f'pairs with {second.best.effect}')
            alone = without_effect(apart, second.best, start, lead.effect)
            first = None if alone is None else _round_of_pair(apart, last.before, alone, start)
            if first is not None:
                steps = (Step(second, second.best), Step(first, first.best))
                return SelectionResult(evaluator, start, first.best, steps)
        if apart.deadline.untried:
            evaluator.deadline.untried[f'pairs with {lead.effect}'] = None
    return None


def _round_of_pair(
    evaluator: Evaluator, before: CandidateFit, one: CandidateFit, start: CandidateFit
) -> SelectionRound | None:
    """Return the round beyond one effect of a pair, None unless it explains all with another."""
    round_ = select(evaluator, one, start, lambda fraction, message: None)
    if round_ is None or not round_.accepted or round_.best.effect == one.effect:
        return None
    pair = round_.best
    explains = (
        not evaluator.has_significant_residual(pair, start)
        and evaluator.explains_enough(before, pair, start)
        and evaluator.is_significant(before, pair, round_.tried)
    )
    return round_ if explains else None


def steps_of(current: CandidateFit, steps: list[Step], last: SelectionRound) -> list[Step]:
    """Return the steps whose effects `current` still contains, with the present fit in the last.

    A new effect may improve the values of earlier effects and be redundant afterwards.
    """

    def count(fit: CandidateFit) -> int:
        return sum(added.effect == last.best.effect for added in fit.added)

    names = {added.effect for added in current.added}
    kept = [step for step in steps if step.fit.effect in names]
    if count(current) == count(last.best):
        return [*kept, Step(last, current)]
    return [*kept[:-1], replace(kept[-1], fit=current)]


@dataclass(frozen=True)
class Outcome:
    """Data of a verdict."""

    found: SelectionResult  # result of the search
    before: CandidateFit
    after: CandidateFit
    remainder: UnexplainedResidual  # residual of the final model
    certainty: float  # probability that the missing effect is among the candidates [1]

    @property
    def ends_in_noise(self) -> bool:
        """Whether the final residual on held-out records is close to the noise."""
        return self.after.floors <= self.found.evaluator.policy.explained_gap


def with_headlines_only(found: SelectionResult) -> SelectionResult:
    """Return the result of a search without effects that reduce the gap too little.

    The known discrepancy of a fixed baseline is not part of the gap: no effect can remove it.
    """
    if not found.steps:
        return found
    if found.evaluator.reduces_gap(found.start, found.final):
        return found
    last = found.last or found.steps[-1].round
    return replace(found, steps=(), final=found.start, last=last)


def outcome_of(found: SelectionResult) -> Outcome:
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
