"""Expected information of an experiment, as functions of plain numbers.

Candidates are discriminated by the expected decrease of entropy, as in the criteria of Hunter and
Reiner 1965 and of Box and Hill 1967. This form saturates: candidates that are distinguished with
certainty cannot be distinguished better. An effect outside the candidates may be hidden with a
size that the records so far would not show; an experiment that detects more of these sizes has a
higher value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray

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
