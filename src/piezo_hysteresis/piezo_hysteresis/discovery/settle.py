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
    """Judge every effect again until nothing changes.

    Returns
    -------
    steps : list of Step
        Of the effects that stay.
    final : Trial
        The model with all of them, fitted jointly.
    """
    kept, final = list(steps), steps[-1].trial
    settled: set[str] = set()
    for _ in range(MOST_ROUNDS * len(steps)):
        words = list(dict.fromkeys(added.effect for added in final.added))
        # the last one was chosen with all others in their places
        open_ones = [word for word in words[:-1] if word not in settled]
        if not open_ones:
            break
        word = open_ones[0]
        settled.add(word)
        without = arena.without(final, start, word)
        if without is None:
            continue
        if arena.is_as_good(without, final):
            kept = [step for step in kept if step.trial.effect != word]
            final, settled = without, set()
            continue
        contest = _contest(arena, without, final, word, progress)
        if contest is None:
            continue
        if arena.score(contest.best) < arena.score(final) - BETTER:
            final, settled = contest.best, {contest.best.effect}
            kept = [step for step in kept if step.trial.effect != word]
            kept.append(Step(contest, final))
        elif contest.best.effect == word:
            here = next(k for k, step in enumerate(kept) if step.trial.effect == word)
            kept[here] = Step(contest, contest.best)
    return kept, final


def _contest(
    arena: Arena, without: Trial, final: Trial, word: str, progress: Progress
) -> Contest | None:
    """Compete for the place of `word`; one that took several elements keeps it."""
    if sum(added.effect == word for added in final.added) > 1:
        return None
    return compete(arena, without, progress)
