"""Belief after some experiments: candidate models, their probabilities, and the residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.rounds import SelectionRound
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.investigation.undetected import Hidden

# Exponent that tempers the shares of candidates: scores from few records are overconfident.
TEMPER = 0.25
# Factor on the standard deviations of fitted values, which contain the noise only.
WIDER = 3.0
# Relative standard deviation of a value without a known one.
VAGUE = 0.3
NO_EFFECT = 'none'


@dataclass(frozen=True)
class CandidateModel:
    """One candidate model with its values."""

    name: str  # name of the effect; ``none`` for the model without it
    chance: float  # probability among the candidates
    fit: ModelSpec
    deviations: dict[str, float]  # standard deviation of each fitted value, in its unit


@dataclass(frozen=True)
class Belief:
    """Probabilities of effects after the experiments so far."""

    verdict: str  # ``none``, ``named`` or ``unknown``, as in discovery
    names: tuple[str, ...]  # named effects, in the order of their selection
    chances: dict[str, float]
    most_probable: tuple[str, float]  # most probable name of the least certain effect
    candidates: tuple[CandidateModel, ...]
    left: bool  # whether a significant residual remains without a name
    floors: float  # held-out gap of the model with the named effects, in multiples of the noise
    alike: bool = False  # whether the records cannot distinguish a named effect from another one
    incomplete: bool = False  # whether the time limit ended the evaluation of the records


def prior_belief(hidden: Hidden) -> Belief:
    """Return the prior belief, before the first experiment."""
    chances = hidden.chances(())
    return Belief('none', (), chances, _first(chances), (), False, float('nan'))


def belief_of(found: Discovery, hidden: Hidden, done: Sequence[str]) -> Belief:
    """Return the belief after a discovery on all records so far."""
    verdict = found.verdict
    names = tuple(effect.name for effect in verdict.effects)
    rounds = _first_rounds(found) if names else []
    contest = min(rounds, key=_certainty) if rounds else found.last
    chances, candidates = hidden.chances(done), tuple[CandidateModel, ...]()
    if contest is not None and contest.finalists:
        chances, candidates = _chances(contest), _candidates(contest, found.alike)
    most_probable = _first(chances)
    for each in rounds:
        name, chance = _first(each.probabilities())
        chances[name] = max(chance, chances.get(name, 0.0))
    chances = dict(sorted(chances.items(), key=lambda each: -each[1]))
    return Belief(
        verdict.verdict,
        names,
        chances,
        most_probable,
        candidates,
        verdict.unexplained.significant,
        verdict.held_out.after_in_floors,
        any(found.alike.values()),
        bool(verdict.not_tried),
    )


def _first_rounds(found: Discovery) -> list[SelectionRound]:
    """Return the round that accepted each name; later ones only add elements of its law."""
    rounds: dict[str, SelectionRound] = {}
    for step in found.steps:
        rounds.setdefault(step.fit.effect, step.round)
    return list(rounds.values())


def _first(chances: dict[str, float]) -> tuple[str, float]:
    return next(iter(chances.items()))


def _certainty(contest: SelectionRound) -> float:
    return max(contest.probabilities().values(), default=0.0)


def _chances(contest: SelectionRound) -> dict[str, float]:
    found = contest.probabilities()
    rest = max(0.0, 1.0 - sum(found.values()))
    every = {**found, NO_EFFECT: rest} if rest > 0.0 else found
    return dict(sorted(every.items(), key=lambda each: -each[1]))


def _candidates(
    contest: SelectionRound, alike: Mapping[str, Sequence[ModelSpec]]
) -> tuple[CandidateModel, ...]:
    """Return the finalists, and the effects that the records cannot distinguish from them.

    An effect that the records cannot distinguish is as probable as the one it resembles.
    """
    shares: FloatArray = np.array(contest.shares) ** TEMPER
    pairs: list[tuple[ModelSpec, float]] = list(zip(contest.finalists, shares, strict=True))
    known = {fit.effect for fit in contest.finalists}
    others = (each for each in alike.get(contest.best.effect, ()) if each.effect not in known)
    pairs += [(model, float(shares[0])) for model in others]
    total = max(sum(share for _, share in pairs), 1e-300)
    return tuple(
        CandidateModel(model.effect, share / total, model, _deviations(model))
        for model, share in pairs
    )


def _deviations(fit: ModelSpec) -> dict[str, float]:
    if not isinstance(fit, CandidateFit):
        own = (name for added in fit.added[-1:] for name in added.names.values())
        return {name: VAGUE * abs(fit.values[name]) for name in own if fit.values[name] != 0.0}
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
