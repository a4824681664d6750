"""Selection of the next experiment by expected information per second."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.detection.limits import APART
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.investigation.belief import Belief, CandidateModel
from piezo_hysteresis.investigation.predict import Outlook, answer_of, sensitivities_of
from piezo_hysteresis.investigation.undetected import Hidden, binary_entropy, discrimination

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
