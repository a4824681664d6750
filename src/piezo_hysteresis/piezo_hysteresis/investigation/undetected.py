"""What may still be hidden: every effect that no record so far would have shown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation.criterion import (
    LARGEST,
    SMALLEST,
    chance_of_news,
    hidden_share,
)
from piezo_hysteresis.investigation.predict import Outlook, answer_of
from piezo_hysteresis.models import candidates

# Sizes at which each effect is looked at, over its usual one.
SIZES = np.geomspace(SMALLEST, LARGEST, 25)
# Other starts of an effect that are looked at besides the first.
STARTS = 3
# Probability beforehand that nothing is hidden.
NOTHING = 0.5


@dataclass(frozen=True)
class Hidden:
    """Effects that a model may lack, and which experiment would show how much of each.

    Attributes
    ----------
    names : tuple of str
        Effect of each way in which one may enter.
    weights : ndarray, shape (n,)
        Probability of each beforehand; with `NOTHING` they add up to 1.
    smallest : dict of str to ndarray, shape (n,)
        By experiment, the smallest size that it would show, over the usual one; infinite where
        it would show none.
    """

    names: tuple[str, ...]
    weights: FloatArray
    smallest: dict[str, FloatArray]

    def seen(self, done: Sequence[str]) -> FloatArray:
        """Return the smallest size of each that experiments would have shown, shape (n,)."""
        rows = [self.smallest[name] for name in done if name in self.smallest]
        return np.min(rows, axis=0) if rows else np.full(len(self.names), np.inf)

    def news(self, done: Sequence[str], name: str, known: Sequence[str] = ()) -> float:
        """Return the probability that an experiment shows what no one before has shown.

        Parameters
        ----------
        done : sequence of str
            Experiments so far.
        name : str
            The one that is judged.
        known : sequence of str
            Effects that are named already.
        """
        weights = self.weights * [each not in known for each in self.names]
        return chance_of_news(weights, self.seen(done), self.smallest[name], NOTHING)

    def chances(self, done: Sequence[str]) -> dict[str, float]:
        """Return how likely nothing is hidden, and each effect, where no news was seen."""
        left = self.weights * hidden_share(self.seen(done))
        total = NOTHING + float(left.sum())
        found = {'none': NOTHING / total}
        for name, chance in zip(self.names, left, strict=True):
            found[name] = found.get(name, 0.0) + float(chance) / total
        return dict(sorted(found.items(), key=lambda each: -each[1]))


def hidden_effects(base: ModelSpec, outlooks: Sequence[Outlook], amplitude: float) -> Hidden:
    """Look at every effect in every experiment.

    Parameters
    ----------
    base : ModelSpec
        The model in use.
    outlooks : sequence of Outlook
        The experiments.
    amplitude : float
        Largest command [V].
    """
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
        if each.effect.refines:  # it shows wherever its plain way does
            continue
        for start in each.starts[:STARTS]:
            yield (
                each.effect.name,
                base.with_candidate(each, each.values(base.values, start)),
            )


def _smallest(spec: ModelSpec, seen: Outlook, sure: float) -> float:
    try:
        answer = answer_of(spec, seen.view)
    except PiezoError:
        return np.inf
    if not np.all(np.isfinite(answer)):
        return np.inf
    return seen.smallest_seen(seen.gap(answer, seen.answer), SIZES, sure)
