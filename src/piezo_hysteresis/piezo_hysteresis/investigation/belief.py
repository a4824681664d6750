"""What is believed after some experiments: rivals, how likely each is, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.rounds import SelectionRound
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.investigation.undetected import Hidden

# Scores of a few records know less than they say: rivals count by their shares to this power.
TEMPER = 0.25
# Deviations of fitted values are counted so many times: they know of noise alone.
WIDER = 3.0
# A value of which no deviation is known may be off by such a share of itself.
VAGUE = 0.3
NOTHING = 'none'


@dataclass(frozen=True)
class Rival:
    """One explanation, with its values.

    Attributes
    ----------
    name : str
        Effect; ``none`` for the model without it.
    chance : float
        Probability, among the rivals.
    fit : CandidateFit
        The model.
    deviations : dict of str to float
        By how much each fitted value may be off, in its unit.
    """

    name: str
    chance: float
    fit: CandidateFit
    deviations: dict[str, float]


@dataclass(frozen=True)
class Belief:
    """What is believed.

    Attributes
    ----------
    verdict : str
        ``none``, ``named`` or ``unknown``, as discovery says it.
    names : tuple of str
        Effects that are named, in the order in which they were found.
    chances : dict of str to float
        Probability by effect, the likeliest first: of every one that is named, and of what else
        the least sure of them may be.
    surest : (str, float)
        The likeliest name of the effect that is least sure, and its probability.
    rivals : tuple of Rival
        What could be distinguished.
    left : bool
        Whether something is left that no name explains.
    floors : float
        Held-out gap of the model with what was found, in multiples of the noise.
    """

    verdict: str
    names: tuple[str, ...]
    chances: dict[str, float]
    surest: tuple[str, float]
    rivals: tuple[Rival, ...]
    left: bool
    floors: float


def nothing_known(hidden: Hidden) -> Belief:
    """Return what is believed before the first experiment."""
    chances = hidden.chances(())
    return Belief('none', (), chances, _first(chances), (), False, float('nan'))


def belief_of(found: Discovery, hidden: Hidden, done: Sequence[str]) -> Belief:
    """Return what is believed after a discovery on all records so far.

    Parameters
    ----------
    found : Discovery
        What came out.
    hidden : Hidden
        What may be missing although no record shows it.
    done : sequence of str
        Experiments so far.
    """
    verdict = found.verdict
    names = tuple(effect.name for effect in verdict.effects)
    rounds = [step.round for step in found.steps] if names else []
    contest = min(rounds, key=_sureness) if rounds else found.last
    chances, rivals = hidden.chances(done), tuple[Rival, ...]()
    if contest is not None and contest.finalists:
        chances, rivals = _chances(contest), _rivals(contest)
    surest = _first(chances)
    for each in rounds:
        name, chance = _first(each.probabilities())
        chances[name] = max(chance, chances.get(name, 0.0))
    chances = dict(sorted(chances.items(), key=lambda each: -each[1]))
    return Belief(
        verdict.verdict,
        names,
        chances,
        surest,
        rivals,
        verdict.unexplained.significant,
        verdict.held_out.after_in_floors,
    )


def _first(chances: dict[str, float]) -> tuple[str, float]:
    return next(iter(chances.items()))


def _sureness(contest: SelectionRound) -> float:
    return max(contest.probabilities().values(), default=0.0)


def _chances(contest: SelectionRound) -> dict[str, float]:
    found = contest.probabilities()
    rest = max(0.0, 1.0 - sum(found.values()))
    every = {**found, NOTHING: rest} if rest > 0.0 else found
    return dict(sorted(every.items(), key=lambda each: -each[1]))


def _rivals(contest: SelectionRound) -> tuple[Rival, ...]:
    shares: FloatArray = np.array(contest.shares) ** TEMPER
    shares = shares / max(float(shares.sum()), 1e-300)
    return tuple(
        Rival(fit.effect, float(share), fit, _deviations(fit))
        for fit, share in zip(contest.finalists, shares, strict=True)
    )


def _deviations(fit: CandidateFit) -> dict[str, float]:
    if fit.fitted is None:
        return {}
    found = {}
    for name, std in fit.fitted.std.items():
        if name == SAMPLING_OFFSET:
            continue
        most = VAGUE * abs(fit.values[name])
        wide = WIDER * std if isfinite(std) else most
        if min(wide, most) > 0.0:
            found[name] = min(wide, most)
    return found
