"""What is true of one record only: how it began, where its zero lies, how well it is known.

A first fit takes a guess. With its model the ways in which a record may have begun can be told
apart, and so can zeros of their own and the weight of each record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.factor import inner
from piezo_hysteresis.identification.reading import misfit
from piezo_hysteresis.identification.record_start import (
    STARTS,
    RecordStart,
    refined,
    rivals,
)
from piezo_hysteresis.identification.targets import WAY_IN, Target, led_in
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record

Square = Callable[[Target], float]

ZEROS = ('auto', 'record', 'common')

# Another start takes over when it takes this share of what is left, and this many times the
# square of the noise: five standard deviations.
_SHARE = 0.1
_SURE = 25.0
# A zero of its own must take more than half of what is left: a shifted sensor does, hardly a model
# that is a little wrong.
_ZERO_SHARE = 0.5
# Residuals beyond so many robust standard deviations of their record pull no harder than these:
# what a model misses in a few moments (a ring-down) shall not bend it everywhere else.
_FAR = 4.0
_MAD = 1.4826
# Shares of the largest voltage by which an unknown level before a record is refined.
_STEPS = (0.12, 0.06, 0.03, 0.015)


@dataclass(frozen=True)
class Choices:
    """What a user says of the records besides what they say themselves.

    Attributes
    ----------
    start : str
        One of `record_start.STARTS`.
    zero : str
        ``record``, ``common`` or ``auto``.

    Raises
    ------
    IdentificationError
        If a word is unknown.
    """

    start: str = 'auto'
    zero: str = 'auto'

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise IdentificationError(
                f'start {self.start!r} is unknown; choose one of {", ".join(STARTS)}'
            )
        if self.zero not in ZEROS:
            raise IdentificationError(
                f'zero {self.zero!r} is unknown; choose one of {", ".join(ZEROS)}'
            )


def revised(
    model: Model,
    values: Mapping[str, float],
    sampling_offset: float,
    targets: Sequence[Target],
    records: Sequence[Record],
    choices: Choices,
    *,
    alone: bool = False,
) -> list[Target]:
    """Return the targets with starts, zeros and weights as the model tells them.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters, of a first fit.
    sampling_offset : float
        As fitted [s].
    targets : sequence of Target
        What the fit compared with.
    records : sequence of Record
        From which they were made.
    choices : Choices
        What the user says.
    alone : bool
        Each record is judged for itself by a model that is known; else they are to be fitted
        together, and one of them cannot have a zero of its own.
    """
    packed = model.pack(values)
    by_name = {record.name: record for record in records}

    def left(target: Target) -> FloatArray:
        with np.errstate(over='ignore', invalid='ignore'):
            return misfit(model, packed, target, sampling_offset)

    def square(target: Target) -> float:
        error = left(target)
        total = inner(error, error)
        return total if np.isfinite(total) else float('inf')

    seen = [_begun(each, by_name, choices, square) for each in targets]
    seen = (
        [_zeroed([each], choices, square)[0] for each in seen]
        if alone
        else _zeroed(seen, choices, square, fewest=2)
    )
    errors = [left(each) for each in seen]
    return [
        replace(each, precision=weight, influence=influence(each, error))
        for each, weight, error in zip(seen, precisions(seen, errors), errors, strict=True)
    ]


def _record_of(target: Target, records: Mapping[str, Record]) -> Record | None:
    name = target.name.removesuffix(WAY_IN)
    record = records.get(name)
    if record is None or target.repeats > 1:
        return None
    return record.section(0, target.voltage.size - target.origin)


def _begun(
    target: Target, records: Mapping[str, Record], choices: Choices, square: Square
) -> Target:
    """Return the target with the start that leaves least, the guess where none does better."""
    record = _record_of(target, records)
    if record is None:
        return target
    wanted = choices.start
    # zeros are judged afterwards: none of them shall pass for a start
    free = replace(target, own_zero=choices.zero != 'common')

    def tried(start: RecordStart) -> tuple[float, RecordStart]:
        return square(led_in(free, record, start)), start

    best = kept = (square(free), target.begins)
    if wanted == 'auto' or record.info.start == 'auto':
        best = min([kept, *map(tried, rivals(record, wanted))], key=lambda each: each[0])
    if best[1].levels:
        for share in _STEPS:
            best = min([best, *map(tried, refined(best[1], record, share))], key=lambda e: e[0])
    gain = kept[0] - best[0]
    noise = target.noise if np.isfinite(target.noise) else 0.0
    if gain > _SHARE * kept[0] and gain > _SURE * noise**2:
        return led_in(target, record, best[1])
    return target


def _zeroed(
    targets: Sequence[Target], choices: Choices, square: Square, fewest: int = 1
) -> list[Target]:
    """Return the targets with zeros of their own where they must have them."""
    if choices.zero != 'auto' or len({t.name.removesuffix(WAY_IN) for t in targets}) < fewest:
        return [replace(each, own_zero=choices.zero == 'record') for each in targets]
    own = [replace(each, own_zero=True) for each in targets]
    common = [replace(each, own_zero=False) for each in targets]
    apart = sum(map(square, own)) < (1.0 - _ZERO_SHARE) * sum(map(square, common))
    return own if apart else common


def precisions(targets: Sequence[Target], errors: Sequence[FloatArray]) -> list[float]:
    """Return the weight of every target by its own noise and what the model misses everywhere.

    A residual is noise of its record and discrepancy of the model. The discrepancy is taken as the
    same in all records, in metres: the median of what their residuals exceed their noise by.
    """
    noise = np.array([t.noise for t in targets])
    if len(targets) < 2 or not np.all(np.isfinite(noise)):
        return [1.0] * len(targets)
    count = np.array([max(e.size - t.lost, 1) for t, e in zip(targets, errors, strict=True)])
    square = np.array([inner(e, e) for e in errors]) / count
    own = noise**2 / np.array([t.repeats for t in targets])
    missed = float(np.median(np.maximum(square - own, 0.0)))
    # of one sample as it was measured: what is missed does not average out over periods, but
    # counts as long as it lasts
    spread = np.sqrt(noise**2 + missed)
    if not np.all(np.isfinite(spread)) or float(spread.min()) <= 0.0:
        return [1.0] * len(targets)
    return [float(v) for v in spread.min() / spread]


def influence(target: Target, error: FloatArray) -> FloatArray | None:
    """Return the factor of each residual, shape (m,), by Huber's rule; None where all are 1."""
    if target.repeats > 1 or not np.all(np.isfinite(error)):
        return None
    size = np.abs(target.kept(error))
    limit = _FAR * _MAD * float(np.median(size)) if size.size else 0.0
    if limit <= 0.0 or float(size.max()) <= limit:
        return None
    return np.asarray(np.sqrt(limit / np.maximum(np.abs(error), limit)))
