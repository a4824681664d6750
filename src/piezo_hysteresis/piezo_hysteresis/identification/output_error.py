"""Output error from data-driven starts: several basins, the best one polished."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.solver import Progress
from piezo_hysteresis.identification.starts import representative, starts
from piezo_hysteresis.identification.targets import Target, targets_of
from piezo_hysteresis.models import Model, for_range
from piezo_hysteresis.records import Record

#: Samples simulated by one start after another, over which `count` is chosen.
_FOLLOWED_SAMPLES = 150_000
#: Records on which starts are followed; the best is polished on all.
_FOLLOWED_RECORDS = 5


def suited(model: Model, records: Sequence[Record]) -> Model:
    """Return `model` with defaults and scales that suit the range of the records."""
    voltage = max(float(np.max(np.abs(r.voltage))) for r in records)
    span = max(float(np.ptp(r.displacement)) for r in records)
    if voltage == 0.0 or span == 0.0:
        raise IdentificationError(
            'neither voltage nor displacement may be constant in all records; record a sine of '
            'the full range'
        )
    return for_range(model, voltage, span / 2)


def output_error(
    model: Model,
    records: Sequence[Record],
    *,
    start: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    weights: str | Mapping[str, float] = 'equal',
    folded: bool = True,
    stride: int = 1,
    sampling_offset: bool | float = True,
    count: int | None = None,
    max_evaluations: int = 200,
    workers: int = 1,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a chain to records by free-run least squares, with start values from the data.

    Parameters
    ----------
    model, records, free, weights, folded, stride, sampling_offset, workers, progress
        See `fit`; a sampling offset of less than three standard deviations is set to zero.
    start : mapping of str to float, optional
        Values known beforehand; the others are found.
    count : int, optional
        Starts that are followed; the best is polished. As many as a second or so allows (3 to
        16) where not given.
    max_evaluations : int
        For the polish; each other start gets a sixth of it.

    Returns
    -------
    FitResult
        Of the best start.

    Raises
    ------
    IdentificationError
        If there is nothing to fit.
    """
    if not records:
        raise IdentificationError('there is no record to fit; give at least one')
    chain = suited(model, records)
    slow = any(block.slot == Slot.SLOW for block in chain.blocks)
    targets = targets_of(records, folded=folded and not slow, stride=stride)
    names = tuple(chain.free_names if free is None else free)
    few = representative(targets, _FOLLOWED_RECORDS)
    if count is None:
        samples = sum(t.voltage.size for t in few)
        count = int(np.clip(_FOLLOWED_SAMPLES // samples, 3, 16))
    begins = starts(chain, targets, names, start, count=count)
    tried = [
        _attempt(chain, few, each.values, names, weights, False, max_evaluations // 6, workers)
        for each in begins
    ]
    best = min(tried, key=lambda each: each.cost)
    offset: bool | float = sampling_offset
    result = _attempt(
        chain, targets, best.values, names, weights, offset, max_evaluations, workers, progress
    )
    late = result.sampling_offset
    if sampling_offset is True and abs(late) < 3 * result.std.get('sampling_offset', np.inf):
        result = _attempt(
            chain, targets, result.values, names, weights, False, max_evaluations, workers
        )
    return result


def _attempt(
    model: Model,
    targets: Sequence[Target],
    values: Mapping[str, float],
    names: Sequence[str],
    weights: str | Mapping[str, float],
    sampling_offset: bool | float,
    evaluations: int,
    workers: int,
    progress: Progress | None = None,
) -> FitResult:
    return fit(
        model,
        (),
        values,
        free=names,
        bounds=_resolvable(values, targets),
        weights=weights,
        sampling_offset=sampling_offset,
        max_evaluations=max(evaluations, 20),
        workers=workers,
        targets=targets,
        progress=progress,
    )


def _resolvable(
    values: Mapping[str, float], targets: Sequence[Target]
) -> dict[str, tuple[float, float]]:
    """Bounds that keep a lightly damped mode off its aliases above half the sampling rate."""
    half = 0.49 / min(t.dt for t in targets)
    light = values.get('damping_ratio', 1.0) < 0.5
    return {'natural_frequency': (0.0, half)} if light else {}
