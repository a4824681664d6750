"""Predictive variance of a model file: response uncertainty due to uncertain parameter values.

A parameter that the fitted records hardly determine, such as the damping of a mode that they do
not excite, may cause a residual on other records. This residual is not a new deviation; it follows
from the covariance of the file.
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

# Relative variance below which a principal direction of the covariance is omitted.
_NONE = 1e-12


def widened(
    expected: Sequence[Expectation],
    base: ModelSpec,
    views: Sequence[Target],
    names: Sequence[str],  # (p, p)
    covariance: FloatArray,  # (p, p)
) -> tuple[Expectation, ...]:
    """Return the expectations of views, increased by the predictive variance of the parameters.

    At a condition where the model was evaluated, the error of its values is already part of the
    known discrepancy; an octave away hardly any of it is.
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
) -> float:  # names, covariance (p, p); price [nats]
    """Return the cost of parameter values that differ from the file [nats].

    Gains that compensate for each other are poorly determined individually and well determined in
    their sum: a change of all of them by one per cent is many standard deviations of the sum and
    hardly one of each. The cost is the lower one of two descriptions. Either some values are new,
    at the price of a parameter each, and the others stay within the covariance; or the same holds
    along the principal directions of the covariance.
    """
    held = price * sum(bool(change) and name not in names for name, change in changes.items())
    at = [k for k, name in enumerate(names) if name in changes]
    step, own = np.array([changes[names[k]] for k in at]), covariance[np.ix_(at, at)]
    along = float(np.minimum(_within(step, own), price).sum())
    return held + min(along, _one_by_one(step, own, price))


def _one_by_one(step: FloatArray, covariance: FloatArray, price: float) -> float:
    """Return the least cost with some new values, selected greedily one at a time [nats]."""
    kept = list(range(step.size))
    best = float(_within(step, covariance).sum())
    for others in range(1, step.size + 1):
        rests = [[each for each in kept if each != k] for k in kept]
        costs = [float(_within(step[r], covariance[np.ix_(r, r)]).sum()) for r in rests]
        kept = rests[int(np.argmin(costs))]
        best = min(best, min(costs) + others * price)
    return best


def _within(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the cost of a change within the covariance per principal direction [nats]."""
    if not np.any(step):
        return np.zeros(step.size)
    found = _principal(covariance)
    if found is None:
        return np.full(step.size, np.inf)
    scale, size, way = found
    size = np.maximum(size, _NONE * max(float(size.max()), _NONE))
    return np.asarray(0.5 * (way.T @ (step / scale)) ** 2 / size)


def _principal(covariance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return standard deviations, and eigenvalues and eigenvectors of the correlation matrix."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    found = symmetric_eigen(covariance / np.outer(scale, scale))
    return None if found is None else (scale, *found)


def _directions(covariance: FloatArray) -> list[FloatArray]:
    """Return steps of one standard deviation along the principal directions."""
    found = _principal(covariance)
    if found is None:
        return []
    scale, size, way = found
    kept = size > _NONE * max(float(size.max()), 0.0)
    return [scale * np.sqrt(s) * v for s, v in zip(size[kept], way.T[kept], strict=True)]


def _moved(
    base: ModelSpec, step: dict[str, float], views: Sequence[Target]
) -> tuple[FloatArray, ...] | None:
    """Return the residuals of a model one step away.

    If the step is invalid, the reversed step or half a step is used; None if all are invalid.
    """
    for factor in (1.0, -1.0, 0.5, -0.5):
        values = {k: v + factor * step.get(k, 0.0) for k, v in base.values.items()}
        try:
            found = errors_of(replace(base, values=values), views)
        except PiezoError:
            continue
        if all(np.all(np.isfinite(error)) for error in found):
            return tuple(found)
    return None
