"""What the values of a model file leave open: how far its answer may be off on new records.

A value that the fitted records hardly told, as the damping of a mode that they did not excite, may
show on others. That is no news: it is what the covariance of the file says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, errors_of
from piezo_hysteresis.discovery.selection.expectation import Expectation
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


def _directions(covariance: FloatArray) -> list[FloatArray]:
    """Return steps of a standard deviation along independent directions."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    found = symmetric_eigen(covariance / np.outer(scale, scale))
    if found is None:
        return []
    size, way = found
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
