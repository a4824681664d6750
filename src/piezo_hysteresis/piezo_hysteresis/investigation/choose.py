"""Which experiment is worth its time most: what it is expected to tell, per second."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.investigation.belief import Belief, Rival
from piezo_hysteresis.investigation.criterion import binary_entropy, discrimination
from piezo_hysteresis.investigation.experiments import PlannedExperiment
from piezo_hysteresis.investigation.predict import Outlook, answer_of, sensitivities_of
from piezo_hysteresis.investigation.undetected import Hidden

# How often one experiment may be run.
MOST_RUNS = 2


@dataclass(frozen=True)
class ExperimentChoice:
    """The next experiment, and why.

    Attributes
    ----------
    experiment : PlannedExperiment
        Which.
    discrimination : float
        By how much it is expected to lower the entropy of the rivals' names [nats].
    news : float
        Probability that it shows something that no record so far has shown.
    why : str
        In one sentence.
    """

    experiment: PlannedExperiment
    discrimination: float
    news: float
    why: str

    @property
    def worth(self) -> float:
        """What it is expected to tell [nats]."""
        return self.discrimination + binary_entropy(self.news)

    @property
    def rate(self) -> float:
        """The same per second of actuator time [nats/s]."""
        return self.worth / self.experiment.seconds


def choices(
    outlooks: Sequence[Outlook],
    belief: Belief,
    hidden: Hidden,
    done: Sequence[str],
    seconds: float,
) -> list[ExperimentChoice]:
    """Return what may be done next, the most telling per second first.

    Parameters
    ----------
    outlooks : sequence of Outlook
        The experiments.
    belief : Belief
        What is believed.
    hidden : Hidden
        What may be missing besides.
    done : sequence of str
        Names of those that have been run.
    seconds : float
        Actuator time that is left [s].
    """
    runs = Counter(done)
    possible = [
        each
        for each in outlooks
        if each.experiment.seconds <= seconds and runs[each.experiment.name] < MOST_RUNS
    ]
    found = [_judged(each, belief, hidden, done) for each in possible]
    return sorted(found, key=lambda each: (-each.rate, each.experiment.name))


def unseen(
    outlooks: Sequence[Outlook],
    belief: Belief,
    hidden: Hidden,
    done: Sequence[str],
    seconds: float,
) -> list[ExperimentChoice]:
    """Return what has not been run yet, as if nothing had: what shows most per second first.

    Where something is seen that nobody can name, none of the rivals is right, and what tells them
    apart says little. Then more of what is seen, under other circumstances, leads on.
    """
    new = [each for each in outlooks if each.experiment.name not in done]
    return [
        replace(each, why='shows what has no name yet under other circumstances')
        for each in choices(new, replace(belief, rivals=()), hidden, (), seconds)
    ]


def _judged(
    seen: Outlook, belief: Belief, hidden: Hidden, done: Sequence[str]
) -> ExperimentChoice:
    names = [rival.name for rival in belief.rivals]
    apart, pair = 0.0, ('', '')
    if len(set(names)) > 1:
        nats = nats_between(belief.rivals, seen)
        chances = np.array([rival.chance for rival in belief.rivals])
        apart = discrimination(chances, names, nats)
        pair = _best_pair(chances, names, nats)
    news = hidden.news(done, seen.experiment.name, belief.names)
    return ExperimentChoice(seen.experiment, apart, news, _why(apart, pair, news))


def nats_between(rivals: Sequence[Rival], seen: Outlook) -> FloatArray:
    """Return by how much rival j would lose where rival i is right, shape (n, n) [nats].

    Rival j may move its values within what they are known to, and so come nearer.
    """
    answers = [answer_of(rival.fit, seen.view) for rival in rivals]
    rows = [sensitivities_of(rival.fit, rival.deviations, seen.view) for rival in rivals]
    nats = np.zeros((len(rivals), len(rivals)))
    for i, j in product(range(len(rivals)), repeat=2):
        if rivals[i].name != rivals[j].name:
            nats[i, j] = seen.nats(seen.gap(answers[i], answers[j], rows[j]))
    return nats


def _best_pair(chances: FloatArray, names: Sequence[str], nats: FloatArray) -> tuple[str, str]:
    """Return the two names that an experiment tells apart best, the likelier first."""
    worth = np.outer(chances, chances) * (1.0 - np.exp(-np.maximum(nats, 0.0)))
    i, j = np.unravel_index(int(np.argmax(worth)), worth.shape)
    one, other = (i, j) if chances[i] >= chances[j] else (j, i)
    return names[int(one)], names[int(other)]


def _why(apart: float, pair: tuple[str, str], news: float) -> str:
    reasons = []
    if apart > 0.0:
        reasons.append(f'distinguishes {pair[0]} and {pair[1]} ({apart:.2g} nats expected)')
    if news > 0.0:
        reasons.append(
            f'has a probability of {news:.1%} to show an effect that no record has shown'
        )
    return ' and '.join(reasons) or 'is the only one left'
