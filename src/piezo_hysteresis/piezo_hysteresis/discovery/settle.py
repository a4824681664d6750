"""Effects that were found one by one, judged again knowing the others.

The first effect was chosen while the others were still in the residual. So each is taken out
again and the place it leaves is competed for anew: what is needless goes, what only resembled the
sum of others is replaced, and what stays is sure in the presence of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from piezo_hysteresis.discovery.compete import Arena, Contest, Progress, compete
from piezo_hysteresis.discovery.trial import Trial

# Another effect takes a place only if it lowers the sum of squares by so much (log).
BETTER = 0.01
MOST_ROUNDS = 3


@dataclass(frozen=True)
class Step:
    """One accepted effect.

    Attributes
    ----------
    contest : Contest
        In which it won, the effects besides it being known.
    trial : Trial
        The model with it.
    """

    contest: Contest
    trial: Trial


def settle(
    arena: Arena, start: Trial, steps: Sequence[Step], progress: Progress
) -> tuple[list[Step], Trial]:
    """Judge every effect but the last one again until nothing changes.

    Returns
    -------
    steps : list of Step
        Of the effects that stay.
    final : Trial
        The model with all of them, fitted jointly.
    """
    kept = list(steps)
    final = kept[-1].trial
    settled: set[str] = set()
    for _ in range(MOST_ROUNDS * len(steps)):
        place = _next(final, settled)
        if place is None:
            break
        settled.add(final.added[place].effect)
        without = arena.without(final, start, place)
        if without is None:
            continue
        word = final.added[place].effect
        if arena.is_as_good(without, final):
            kept = [step for step in kept if step.trial.effect != word]
            final = without
            continue
        contest = compete(arena, without, progress)
        if contest is None:
            continue
        if arena.score(contest.best) < arena.score(final) - BETTER:
            final = contest.best
            settled = {contest.best.effect}
            kept = [step for step in kept if step.trial.effect != word]
            kept.append(Step(contest, final))
        elif contest.best.effect == word:
            here = next(k for k, step in enumerate(kept) if step.trial.effect == word)
            kept[here] = Step(contest, contest.best)
    return kept, final


def _next(final: Trial, settled: set[str]) -> int | None:
    """Return the first effect to judge; ones that took several elements stay as they are."""
    words = [added.effect for added in final.added]
    for place, word in enumerate(words[:-1]):
        if word not in settled and words.count(word) == 1:
            return place
    return None
