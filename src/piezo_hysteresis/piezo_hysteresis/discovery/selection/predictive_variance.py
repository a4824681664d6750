"""What the values of a model file leave open: how far its answer may be off on new records.

A value that the fitted records hardly determined, as the damping of a mode that they did not
excite, may show on others. That is no news: it is what the covariance of the file says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, errors_of
from piezo_hysteresis.discovery.selection.residual_model import Expectation
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.numerics.linalg import symmetric_eigen

# Directions with less than this share of the largest variance, in standard deviations, are none.
_NONE = 1e-12


def widened(
    expected: Sequence[Expectation],
    base: ModelSpec,
    views: Sequence[Target],
    names: Sequence[str],
    covariance: FloatArray,
) -> tuple[Expectation, ...]:
    """Return what is no news of views, with what uncertain values may do besides.

    Under a condition under which the model was judged, what its values do wrong is in what it
    misses there already; an octave away, hardly any of it is.

    Parameters
    ----------
    expected : sequence of Expectation
        Of each view.
    base : ModelSpec
        The model as its file says.
    views : sequence of Target
        What it is driven with.
    names, covariance : sequence of str, ndarray of shape (p, p)
        Of the values. Where the file does not tell that of all which were fitted, nothing is
        added: the others may make up for what one alone would do.
    """
    if not names or set(names) != set(base.model.free_names):
        return tuple(expected)
    shares = [1.0 - float(np.exp(-2.0 * each.octaves)) for each in expected]
    more = [np.zeros_like(each.expected) for each in expected]
    own = errors_of(base, views)
    for step in _directions(covariance):
        moved = _moved(base, dict(zip(names, step, strict=True)), views)
        for k, error in enumerate(moved or ()):
            powers = expected[k].powers(error - own[k])
            if np.all(np.isfinite(powers)):
                more[k] += shares[k] * powers
    return tuple(replace(x, expected=x.expected + m) for x, m in zip(expected, more, strict=True))


def cost_of_change(
    changes: Mapping[str, float], names: Sequence[str], covariance: FloatArray, price: float
) -> float:
    """Return what it costs that values are others than the file says [nats].

    Gains that make up for each other are determined badly one by one, and well in their sum: a
    change of all of them by a percent is many deviations of that sum and hardly one of any. So a
    change is determined in one of two ways, the cheaper counts: some values are others, at the
    price of a parameter each, and the rest lies within its deviations; or so along independent
    directions.

    Parameters
    ----------
    changes : mapping of str to float
        Of values; one that is not among `names` was held, and its change is another value.
    names, covariance : sequence of str, ndarray of shape (p, p)
        Of the values that were fitted.
    price : float
        Of a parameter [nats].
    """
    held = price * sum(bool(change) and name not in names for name, change in changes.items())
    at = [k for k, name in enumerate(names) if name in changes]
    step, own = np.array([changes[names[k]] for k in at]), covariance[np.ix_(at, at)]
    along = float(np.minimum(_within(step, own), price).sum())
    return held + min(along, _one_by_one(step, own, price))


def _one_by_one(step: FloatArray, covariance: FloatArray, price: float) -> float:
    """Return the least cost where some values are others, found one after another [nats]."""
    kept = list(range(step.size))
    best = float(_within(step, covariance).sum())
    for others in range(1, step.size + 1):
        rests = [[each for each in kept if each != k] for k in kept]
        costs = [float(_within(step[r], covariance[np.ix_(r, r)]).sum()) for r in rests]
        kept = rests[int(np.argmin(costs))]
        best = min(best, min(costs) + others * price)
    return best


def _within(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return what lies within deviations costs along each independent direction [nats]."""
    if not np.any(step):
        return np.zeros(step.size)
    found = _principal(covariance)
    if found is None:
        return np.full(step.size, np.inf)
    scale, size, way = found
    size = np.maximum(size, _NONE * max(float(size.max()), _NONE))
    return np.asarray(0.5 * (way.T @ (step / scale)) ** 2 / size)


def _principal(covariance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return deviations, and the principal values and directions of the correlation."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    found = symmetric_eigen(covariance / np.outer(scale, scale))
    return None if found is None else (scale, *found)


def _directions(covariance: FloatArray) -> list[FloatArray]:
    """Return steps of a standard deviation along independent directions."""
    found = _principal(covariance)
    if found is None:
        return []
    scale, size, way = found
    kept = size > _NONE * max(float(size.max()), 0.0)
    return [scale * np.sqrt(s) * v for s, v in zip(size[kept], way.T[kept], strict=True)]


def _moved(
    base: ModelSpec, step: dict[str, float], views: Sequence[Target]
) -> tuple[FloatArray, ...] | None:
    """Return the errors of a model a step away, or half of one or back where it cannot be."""
    for factor in (1.0, -1.0, 0.5, -0.5):
        values = {k: v + factor * step.get(k, 0.0) for k, v in base.values.items()}
        try:
            found = errors_of(replace(base, values=values), views)
        except PiezoError:
            continue
        if all(np.all(np.isfinite(error)) for error in found):
            return tuple(found)
    return None
