"""Effects added one by one, settled, and begun again with another first one where that fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from piezo_hysteresis.discovery.arena import SURE, Arena
from piezo_hysteresis.discovery.compete import Contest, compete
from piezo_hysteresis.discovery.settle import BETTER, Step, settle
from piezo_hysteresis.discovery.significance import improvement
from piezo_hysteresis.discovery.trial import Trial

Progress = Callable[[float, str], None]

MOST_EFFECTS = 5
# An improvement counts if it takes at least this share of what is above the floor.
SHARE = 0.25
# Laws are not quite those of the actuator and leave crumbs, for which some effect always finds a
# use. Of what is so small, or up to so many times larger, a real effect takes nearly all or most.
NEARLY_ALL = 0.9
MOST_OF_IT = 0.6
MAY_BE_CRUMB = 3.0
# What is left counts as explained up to this gap [floors].
NEAR = 1.2
# Evaluations of a fit that is to end where nothing is left to gain.
THOROUGH = 200
# Where the first effect led nowhere, the next best ones of its round get a turn: so many, if their
# sum of squares was not larger by more than this.
BRANCHES = 2
CLOSE = 2.0

Found = tuple[Arena, list[Step], Trial, Contest | None]


def search(arena: Arena, start: Trial, progress: Progress) -> Found:
    """Find the effects that `start` lacks.

    What is missing besides can let a wrong effect win the first round, and the right one of the
    same place in the model cannot take it back afterwards. So where much is left in the end, the
    search begins again with what came next in that round, and the better end counts.

    Returns
    -------
    arena : Arena
        In which the end is judged.
    steps : list of Step
        Accepted effects; empty where nothing is missing or nothing known helps.
    final : Trial
        The model with all of them, fitted jointly.
    last : Contest or None
        The round that named nothing more, where there was one.
    """
    seen, steps, last = _compete(arena, start, [], progress)
    if not steps:
        return seen, steps, start, last
    first = steps[0].contest
    progress(0.85, 'judging every effect knowing the others')
    best = _settled(seen, start, steps, last)
    for step in _others(arena, first):
        if not _leaves_much(best):
            break
        progress(0.9, f'beginning again with {step.trial.effect}')
        again = [replace(step, trial=arena.refit(step.trial, THOROUGH))]
        seen, steps, last = _compete(arena.on_one_clock(first.before), start, again, _silent)
        other = _settled(seen, start, steps, last)
        if seen.score(other[2]) < best[0].score(best[2]) - BETTER:
            best = other
    return best


def _settled(arena: Arena, start: Trial, steps: list[Step], last: Contest | None) -> Found:
    return arena, *settle(arena, start, steps, _silent), last


def _silent(fraction: float, words: str) -> None:
    """Tell nobody: a second search goes over the same ground."""


def _leaves_much(found: Found) -> bool:
    arena, _, final, _ = found
    return final.floors > NEAR and arena.lacks_something(final)


def _others(arena: Arena, first: Contest) -> list[Step]:
    """Return what else the search may begin with: what came close in the first round."""
    found: list[Step] = []
    taken = {first.best.effect}
    for k, trial in enumerate(first.finalists):
        if trial.effect in taken or trial.square > CLOSE * first.best.square:
            continue
        taken.add(trial.effect)
        order = [k, *(j for j in range(len(first.finalists)) if j != k)]
        contest = replace(
            first,
            finalists=tuple(first.finalists[j] for j in order),
            shares=tuple(first.shares[j] for j in order),
            gain=improvement(first.before, trial, arena.edges, first.tried),
        )
        found.append(Step(contest, trial))
    return found[:BRANCHES]


def _compete(
    arena: Arena, start: Trial, steps: list[Step], progress: Progress
) -> tuple[Arena, list[Step], Contest | None]:
    """Add effects to those of `steps` one by one until nothing significant is left."""
    current = steps[-1].trial if steps else start
    contest: Contest | None = None
    for place in range(len(steps), MOST_EFFECTS):
        if _done(arena, current, start):
            return arena, steps, None
        begin, share = 0.12 + 0.7 * place / MOST_EFFECTS, 0.7 / MOST_EFFECTS

        def told(fraction: float, words: str, begin: float = begin, share: float = share) -> None:
            progress(begin + share * fraction, words)

        arena = arena.on_one_clock(current)
        contest = compete(arena, current, told)
        if contest is None or not accepted(arena, contest, start):
            return arena, steps, contest
        # A fit that stopped short would leave crumbs for which the next round finds a name.
        found = arena.refit(contest.best, THOROUGH)
        current = arena.pruned(found, start)
        words = {added.effect for added in current.added}
        steps = [s for s in (*steps, Step(contest, found)) if s.trial.effect in words]
        steps[-1] = replace(steps[-1], trial=current)
    return arena, steps, contest


def _done(arena: Arena, current: Trial, start: Trial) -> bool:
    """Tell whether nothing is left to name: at most a crumb in one record of a gap closed."""
    crumb = arena.is_crumb(current, start) and arena.excess(current) < arena.negligible
    return crumb or not arena.lacks_something(current)


def accepted(arena: Arena, contest: Contest, start: Trial) -> bool:
    """Tell whether the winner of a contest is an effect: sure, and not a crumb."""
    needed = SHARE
    if arena.is_crumb(contest.before, start):
        needed = NEARLY_ALL
    elif arena.is_crumb(contest.before, start, MAY_BE_CRUMB):
        needed = MOST_OF_IT
    before, after = arena.excess(contest.before), arena.excess(contest.best)
    share = (before - after) / max(before, 1e-12)
    better = arena.score(contest.best) < arena.score(contest.before)
    return better and contest.gain.ratio >= SURE and share >= needed
