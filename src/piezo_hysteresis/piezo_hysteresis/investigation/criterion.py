"""What an experiment is expected to tell, as functions of plain numbers.

Between rivals the expected loss of entropy decides, as in the criteria of Hunter and Reiner 1965
and of Box and Hill 1967, of which it is the form that saturates: rivals that are distinguished for
sure cannot be distinguished better. What no rival explains yet may still be hidden in a size that
the records so far would not have shown; an experiment that would show more sizes is worth more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray

# Sizes of a hidden effect, over its usual size, between which any is as likely by its logarithm.
SMALLEST, LARGEST = 0.05, 3.0


def entropy(chances: FloatArray) -> float:
    """Return the entropy of probabilities, shape (n,), that add up to 1 [nats]."""
    kept = chances[chances > 0.0]
    return float(-np.sum(kept * np.log(kept)))


def grouped(chances: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the probabilities of different names, those of equal ones added up."""
    order = {name: place for place, name in enumerate(dict.fromkeys(names))}
    places = [order[name] for name in names]
    return np.asarray(np.bincount(places, chances, len(order)), dtype=np.float64)


def discrimination(chances: FloatArray, names: Sequence[str], nats: FloatArray) -> float:
    """Return by how much an experiment lowers the entropy of the names, as expected [nats].

    Parameters
    ----------
    chances : ndarray, shape (n,)
        Probability of each rival before it; they add up to 1.
    names : sequence of str
        What each rival is called; those of one name need not be distinguished.
    nats : ndarray, shape (n, n)
        By how much rival j loses log likelihood where rival i is right.
    """
    after = 0.0
    for place in np.flatnonzero(chances):
        weights = chances * np.exp(-np.maximum(nats[place], 0.0))
        after += float(chances[place]) * entropy(grouped(weights / weights.sum(), names))
    return max(0.0, entropy(grouped(chances, names)) - after)


def hidden_share(size: FloatArray) -> FloatArray:
    """Return the share of the likely sizes that lie below `size`, any shape [1]."""
    span = np.log(LARGEST / SMALLEST)
    bounded = np.clip(size, SMALLEST, LARGEST)
    return np.asarray(np.log(bounded / SMALLEST) / span)


def chance_of_news(
    weights: FloatArray, seen: FloatArray, new: FloatArray, nothing: float
) -> float:
    """Return the probability that an experiment shows an effect that no record has shown.

    Parameters
    ----------
    weights : ndarray, shape (n,)
        Probability of each effect beforehand.
    seen : ndarray, shape (n,)
        Smallest size of each that would have been seen in the records so far.
    new : ndarray, shape (n,)
        Smallest size of each that the experiment would show.
    nothing : float
        Probability beforehand that nothing is hidden.
    """
    before = hidden_share(seen)
    gained = np.maximum(before - hidden_share(new), 0.0)
    return float(weights @ gained / (nothing + weights @ before))


def binary_entropy(chance: float) -> float:
    """Return what the answer to a question of yes or no tells [nats]."""
    return entropy(np.array([chance, 1.0 - chance]))
