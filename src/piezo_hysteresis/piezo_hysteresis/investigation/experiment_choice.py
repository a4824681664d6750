"""Selection of the next experiment by expected information per second."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.detection.limits import APART
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.discovery.selection.rounds import SelectionRound
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.investigation.predict import Outlook, answer_of, sensitivities_of
from piezo_hysteresis.models import candidates

# Bounds of the log-uniform prior of the size of a hidden effect, relative to its usual size.
SMALLEST, LARGEST = 0.05, 3.0


def entropy(chances: FloatArray) -> float:
    """Return the entropy of probabilities, shape (n,), with sum 1 [nats]."""
    kept = chances[chances > 0.0]
    return float(-np.sum(kept * np.log(kept)))


def grouped(chances: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the probabilities summed over equal names."""
    order = {name: place for place, name in enumerate(dict.fromkeys(names))}
    places = [order[name] for name in names]
    return np.asarray(np.bincount(places, chances, len(order)), dtype=np.float64)


def discrimination(chances: FloatArray, names: Sequence[str], nats: FloatArray) -> float:
    """Return the expected decrease of the entropy of the names by an experiment [nats]."""
    # chances (n,); nats (n, n)
    after = 0.0
    for place in np.flatnonzero(chances):
        weights = chances * np.exp(-np.maximum(nats[place], 0.0))
        after += float(chances[place]) * entropy(grouped(weights / weights.sum(), names))
    return max(0.0, entropy(grouped(chances, names)) - after)


def hidden_share(size: FloatArray) -> FloatArray:
    """Return the prior probability of sizes below `size`, any shape [1]."""
    span = np.log(LARGEST / SMALLEST)
    bounded = np.clip(size, SMALLEST, LARGEST)
    return np.asarray(np.log(bounded / SMALLEST) / span)


def detection_probability(
    weights: FloatArray, seen: FloatArray, new: FloatArray, nothing: float
) -> float:  # weights, seen, new (n,)
    """Return the probability that an experiment shows an effect that no record has shown."""
    before = hidden_share(seen)
    gained = np.maximum(before - hidden_share(new), 0.0)
    return float(weights @ gained / (nothing + weights @ before))


def binary_entropy(chance: float) -> float:
    """Return the entropy of a binary outcome [nats]."""
    return entropy(np.array([chance, 1.0 - chance]))


# Sizes at which each effect is tested, relative to its usual size.
SIZES = np.geomspace(SMALLEST, LARGEST, 25)
# Number of starting values of an effect that are tested.
STARTS = 3
# Prior probability that no effect is hidden.
NOTHING = 0.5


@dataclass(frozen=True)
class Hidden:
    """Effects that a model may lack, and their smallest detectable size in each experiment."""

    names: tuple[str, ...]  # effect of each tested variant and starting value
    weights: FloatArray  # prior probability of each; the sum with `NOTHING` is 1, shape (n,)
    smallest: dict[str, FloatArray]  # smallest detectable size by experiment, shape (n,)

    def seen(self, done: Sequence[str]) -> FloatArray:
        """Return the smallest detectable size of each effect so far, shape (n,)."""
        rows = [self.smallest[name] for name in done if name in self.smallest]
        return np.min(rows, axis=0) if rows else np.full(len(self.names), np.inf)

    def first_detection(self, done: Sequence[str], name: str, known: Sequence[str] = ()) -> float:
        """Return the probability that an experiment shows an effect for the first time."""
        weights = self.weights * [each not in known for each in self.names]
        return detection_probability(weights, self.seen(done), self.smallest[name], NOTHING)

    def chances(self, done: Sequence[str]) -> dict[str, float]:
        """Return the probability of no and of each hidden effect, given no visible residual."""
        left = self.weights * hidden_share(self.seen(done))
        total = NOTHING + float(left.sum())
        found = {'none': NOTHING / total}
        for name, chance in zip(self.names, left, strict=True):
            found[name] = found.get(name, 0.0) + float(chance) / total
        return dict(sorted(found.items(), key=lambda each: -each[1]))


def hidden_effects(base: ModelSpec, outlooks: Sequence[Outlook], amplitude: float) -> Hidden:
    """Compute the smallest detectable size of every effect in every experiment."""
    # amplitude [V]
    span = 0.5 * max(each.stroke for each in outlooks if np.isfinite(each.stroke))
    names, models = [], []
    for name, spec in _lacking(base, amplitude, span):
        names.append(name)
        models.append(spec)
    count = Counter(names)
    weights = np.array([(1.0 - NOTHING) / len(count) / count[name] for name in names])
    sure = HELD.sure + float(np.log(max(len(names), 1)))
    smallest = {
        each.experiment.name: np.array([_smallest(spec, each, sure) for spec in models])
        for each in outlooks
    }
    return Hidden(tuple(names), weights, smallest)


def _lacking(base: ModelSpec, amplitude: float, span: float) -> Iterator[tuple[str, ModelSpec]]:
    for each in candidates(base.model, amplitude, span):
        if each.effect.refines:  # detectable wherever the simpler variant is
            continue
        for start in each.starts[:STARTS]:
            yield (each.effect.name, base.with_candidate(each, each.values(base.values, start)))


def _smallest(spec: ModelSpec, seen: Outlook, sure: float) -> float:
    try:
        answer = answer_of(spec, seen.view)
    except PiezoError:
        return np.inf
    if not np.all(np.isfinite(answer)):
        return np.inf
    return seen.smallest_seen(seen.gap(answer, seen.answer), SIZES, sure)


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


# Largest number of runs of one experiment.
MOST_RUNS = 2


@dataclass(frozen=True)
class ExperimentChoice:
    """The next experiment and the reason of its selection."""

    experiment: PlannedExperiment  # the selected experiment
    discrimination: float  # expected decrease of the entropy of the candidate names [nats]
    first_detection: float  # probability that it shows an effect that no record so far has shown
    why: str  # reason, in one sentence

    @property
    def worth(self) -> float:
        """Expected information [nats]."""
        return self.discrimination + binary_entropy(self.first_detection)

    @property
    def rate(self) -> float:
        """Expected information per second of actuator time [nats/s]."""
        return self.worth / self.experiment.seconds


def choices(
    outlooks: Sequence[Outlook],
    belief: Belief,
    hidden: Hidden,
    done: Sequence[str],
    seconds: float,  # [s]
) -> list[ExperimentChoice]:
    """Return the possible next experiments, highest expected information per second first."""
    runs = Counter(done)
    possible = [
        each
        for each in outlooks
        if each.experiment.seconds <= seconds and runs[each.experiment.name] < MOST_RUNS
    ]
    found = [_evaluated(each, belief, hidden, done) for each in possible]
    return sorted(found, key=lambda each: (-each.rate, each.experiment.name))


def unseen(
    outlooks: Sequence[Outlook],
    belief: Belief,
    hidden: Hidden,
    done: Sequence[str],
    seconds: float,
) -> list[ExperimentChoice]:
    """Return the experiments that have not run yet, ranked as if no record existed.

    If a significant residual matches no candidate, none of the candidates is correct and their
    discrimination has little value. Records of this residual under other conditions add more
    information.
    """
    new = [each for each in outlooks if each.experiment.name not in done]
    return [
        replace(each, why='shows the unexplained residual under another condition')
        for each in choices(new, replace(belief, candidates=()), hidden, (), seconds)
    ]


def _evaluated(
    seen: Outlook, belief: Belief, hidden: Hidden, done: Sequence[str]
) -> ExperimentChoice:
    names = [candidate.name for candidate in belief.candidates]
    apart, pair = 0.0, ('', '', 0.0)
    if len(set(names)) > 1:
        away = distances(belief.candidates, seen)
        chances = np.array([candidate.chance for candidate in belief.candidates])
        apart = discrimination(chances, names, 0.5 * away**2)
        pair = _best_pair(chances, names, away)
    first_detection = hidden.first_detection(done, seen.experiment.name, belief.names)
    return ExperimentChoice(
        seen.experiment, apart, first_detection, _why(apart, pair, first_detection)
    )


def distances(candidates: Sequence[CandidateModel], seen: Outlook) -> FloatArray:
    """Return the distance of candidate i from candidate j in an experiment, shape (n, n).

    In standard deviations, as the distances of `detection.look_alikes`; 0 for candidates of one
    name. Candidate j may adapt its values within their uncertainty.
    """
    answers = [answer_of(candidate.fit, seen.view) for candidate in candidates]
    rows = [
        sensitivities_of(candidate.fit, candidate.deviations, seen.view)
        for candidate in candidates
    ]
    away = np.zeros((len(candidates), len(candidates)))
    for i, j in product(range(len(candidates)), repeat=2):
        if candidates[i].name != candidates[j].name:
            away[i, j] = seen.distance(answers[i], answers[j], rows[j])
    return away


def _best_pair(
    chances: FloatArray, names: Sequence[str], away: FloatArray
) -> tuple[str, str, float]:
    """Return the two names that an experiment distinguishes best, and their distance."""
    worth = np.outer(chances, chances) * (1.0 - np.exp(-0.5 * away**2))
    i, j = np.unravel_index(int(np.argmax(worth)), worth.shape)
    one, other = (i, j) if chances[i] >= chances[j] else (j, i)
    return names[int(one)], names[int(other)], float(away[i, j])


def _why(apart: float, pair: tuple[str, str, float], first_detection: float) -> str:
    reasons = []
    if apart > 0.0:
        one, other, away = pair
        reasons.append(
            f'distinguishes {one} and {other} ({away:.2g} standard deviations apart, {APART:g} '
            f'needed; {apart:.2g} nats expected)'
        )
    if first_detection > 0.0:
        reasons.append(f'has a probability of {first_detection:.1%} to show a new effect')
    return ' and '.join(reasons) or 'is the only remaining experiment'
