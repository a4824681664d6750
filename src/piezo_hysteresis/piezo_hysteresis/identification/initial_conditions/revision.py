"""Estimation of the nuisances of records by a model: initial condition, zero, weight.

A first fit uses guesses. With its model, initial conditions are compared, and zeros and weights of
the records are estimated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.stated import STARTS, ZEROS
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit_data import WAY_IN, FitData
from piezo_hysteresis.identification.initial_conditions.start_hypotheses import (
    InitialConditionSelector,
    square_of,
)
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

# A zero per record must reduce the cost by more than half: a shifted sensor does, a small model
# error does not.
ZERO_SHARE = 0.5
# Robust standard deviations beyond which the influence of a residual is constant (Huber): a short
# model error (a ring-down) must not distort the fit elsewhere.
_FAR = 4.0
_MAD = 1.4826
# Robust standard deviations within which an excluded sample is explained by the model.
_UNLIKE = 8.0


@dataclass(frozen=True)
class RecordAssumptions:
    """Initial condition and zero of the records as stated by the user."""

    start: str = 'auto'  # one of `stated.STARTS`
    zero: str = 'auto'  # ``record``, ``common`` or ``auto``

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise IdentificationError(
                f'the initial condition {self.start!r} is unknown{choices(self.start, STARTS)}'
            )
        if self.zero not in ZEROS:
            raise IdentificationError(f'zero {self.zero!r} is unknown{choices(self.zero, ZEROS)}')


def zeros_lie_apart(own: float, shared: float) -> bool:
    """Return whether a zero per record reduces the cost so much that records need one."""
    return own < (1.0 - ZERO_SHARE) * shared


def estimate_nuisances(
    model: Model,
    values: Mapping[str, float],
    sampling_offset: float,  # [s]
    targets: Sequence[FitData],
    records: Sequence[Record],
    choices: RecordAssumptions,
    *,
    alone: bool = False,
    workers: int = 1,
) -> list[FitData]:
    """Return the targets with starts, zeros and weights as the model estimates them."""
    search = InitialConditionSelector(
        model, values, sampling_offset, records, choices.start, lasting=alone
    )
    given = [with_explained(search, each) for each in targets]
    seen = of_each(lambda each: search.best_start(each, choices.zero), given, workers)
    if alone:
        ended = [search.settled(_choose_zeros([each], choices, search)[0]) for each in seen]
        pairs = zip(ended, given, strict=True)
        seen = [search.as_run(each, first, choices.zero) for each, first in pairs]
    else:
        seen = _choose_zeros(seen, choices, search, fewest=2)
    errors = [search.left(each) for each in seen]
    return [
        replace(each, precision=weight, influence=influence(each, error))
        for each, weight, error in zip(seen, precisions(seen, errors), errors, strict=True)
    ]


def with_explained(search: InitialConditionSelector, target: FitData) -> FitData:
    """Return the target with those excluded samples taken back that the model explains.

    The residual of an explained sample is as small as that of most others.
    """
    if target.valid is None:
        return target
    error = search.left(replace(target, valid=None))
    kept = target.kept(error)
    if not kept.size or not np.all(np.isfinite(error)):
        return target
    middle = float(np.median(kept))
    limit = _UNLIKE * _MAD * float(np.median(np.abs(kept - middle)))
    valid = np.where(np.abs(error - middle) <= limit, 1.0, target.valid)
    return replace(target, valid=None if np.all(valid > 0.0) else valid)


def _choose_zeros(
    targets: Sequence[FitData],
    choices: RecordAssumptions,
    search: InitialConditionSelector,
    fewest: int = 1,
) -> list[FitData]:
    """Return the targets, with a zero per record where they need one.

    With `fewest` above one the records are fitted together, and their common zero is estimated
    again.
    """
    if choices.zero != 'auto' or len({t.name.removesuffix(WAY_IN) for t in targets}) < fewest:
        return [replace(each, own_zero=choices.zero == 'record') for each in targets]
    own = [replace(each, own_zero=True) for each in targets]
    common = [replace(each, own_zero=False) for each in targets]
    errors = [search.left(each) for each in common]
    if fewest > 1:
        samples = sum(each.size for each in errors)
        shared = sum(float(each.sum()) for each in errors) / samples
        errors = [each - shared for each in errors]
    squares = sum(map(search.square, own)), sum(map(square_of, errors))
    return own if zeros_lie_apart(*squares) else common


def precisions(targets: Sequence[FitData], errors: Sequence[FloatArray]) -> list[float]:
    """Return the weight of every target from its noise and the discrepancy of the model.

    A residual is the sum of measurement noise and model discrepancy. The discrepancy is assumed
    equal in all records, in metres: the median excess of their residuals over their noise.
    """
    noise = np.array([t.noise for t in targets])
    if len(targets) < 2 or not np.all(np.isfinite(noise)):
        return [1.0] * len(targets)
    count = np.array([max(e.size - t.lost, 1) for t, e in zip(targets, errors, strict=True)])
    square = np.array([inner(e, e) for e in errors]) / count
    own = noise**2 / np.array([t.repeats for t in targets])
    missed = float(np.median(np.maximum(square - own, 0.0)))
    # per measured sample: the discrepancy does not average out over periods, but counts for
    # its whole duration
    spread = np.sqrt(noise**2 + missed)
    if not np.all(np.isfinite(spread)) or float(spread.min()) <= 0.0:
        return [1.0] * len(targets)
    return [float(v) for v in spread.min() / spread]


def influence(target: FitData, error: FloatArray) -> FloatArray | None:
    """Return the factor of each residual, shape (m,), by Huber's rule; None where all are 1."""
    if target.repeats > 1 or not np.all(np.isfinite(error)):
        return None
    size = np.abs(target.kept(error))
    limit = _FAR * _MAD * float(np.median(size)) if size.size else 0.0
    if limit <= 0.0 or float(size.max()) <= limit:
        return None
    return np.asarray(np.sqrt(limit / np.maximum(np.abs(error), limit)))
