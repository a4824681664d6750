"""Effects that may be hidden, because no record so far would have shown them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation.predict import Outlook, answer_of
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
