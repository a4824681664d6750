"""Forward selection of effects, backward elimination, and restarts of the search."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.elimination import (
    Step,
    pruned,
    retested,
    without_unfinished,
)
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.finalist_starts import led_by_best_start
from piezo_hysteresis.discovery.selection.rounds import Progress, SelectionRound, select


@dataclass(frozen=True)
class Found:
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


def search(evaluator: Evaluator, start: CandidateFit, progress: Progress) -> Found:
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
            best = other
    return best


def eliminated(found: Found) -> Found:
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
    return Found(evaluator, found.start, final, tuple(steps), last)


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
) -> Found:
    """Add effects to those of `steps` one at a time until no significant residual remains."""
    current = steps[-1].fit if steps else start
    most = evaluator.policy.max_effects
    last: SelectionRound | None = None
    for place in range(len(steps), most):
        if not evaluator.has_significant_residual(current, start):
            return Found(evaluator, start, current, tuple(steps))
        if steps and evaluator.deadline.skips('a further effect'):
            return Found(evaluator, start, current, tuple(steps))
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
            return Found(evaluator, start, current, tuple(steps), last)
        current = _finished(evaluator, last.best)
        if evaluator.policy.elimination_rounds:
            current = pruned(evaluator, current, start)
        steps = steps_of(current, steps, last)
    return Found(evaluator, start, current, tuple(steps), last)


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
