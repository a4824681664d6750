"""Output-error fit from several data-driven start values, with refinement of the best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit import FitResult, fit
from piezo_hysteresis.identification.fit_data import FitData, targets_of
from piezo_hysteresis.identification.initial_conditions.revision import (
    RecordAssumptions,
    estimate_nuisances,
    zeros_lie_apart,
)
from piezo_hysteresis.identification.initial_conditions.start_hypotheses import (
    InitialConditionSelector,
)
from piezo_hysteresis.identification.noise import stroke_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Prior
from piezo_hysteresis.identification.solver import Progress
from piezo_hysteresis.identification.starts import Simulated, Start, representative, starts
from piezo_hysteresis.models import Model, for_range
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

#: Number of simulated samples over all starts, which determines `count`.
_FOLLOWED_SAMPLES = 150_000
#: Number of records for the coarse fits; the best start is refined on all records.
_FOLLOWED_RECORDS = 5
#: Largest number of re-estimations of the nuisances after a fit, and the relative change of a
#: weight that requires a new fit.
_REVISIONS = 6
#: A sampling offset of zero is kept if the sum of squares is larger by at most this share, or by
#: three standard deviations of its random variation.
_NO_WORSE, _CHANCE = 1e-3, 9.0
_ALIKE = 0.2
#: Starts whose cost is within this factor of the best have converged to the same optimum; so many
#: are sufficient.
_SAME = 1.01
_ENOUGH = 4
#: Ratio of the mean square of the residual to that of the noise up to which only noise remains.
_NOISE = 1.1
#: Largest number of fits with held levels, and the relative gain that makes another one useful.
_HELD_TURNS, _BETTER = 4, 0.02


def suited(model: Model, records: Sequence[Record]) -> Model:
    """Return `model` with defaults and scales that suit the range of the records."""
    voltage = max(float(np.max(np.abs(r.voltage))) for r in records)
    span = max(stroke_of(r) for r in records)
    if voltage == 0.0 or span == 0.0:
        raise IdentificationError(
            'neither voltage nor displacement may be constant in all records; record a sine of '
            'the full range'
        )
    low = min(float(r.voltage.min()) for r in records)
    high = max(float(r.voltage.max()) for r in records)
    return for_range(model, voltage, span / 2, (high - low) / 2)


def output_error(
    model: Model,
    records: Sequence[Record],
    *,
    start: Mapping[str, float] | None = None,
    guesses: Sequence[Mapping[str, float]] = (),
    free: Sequence[str] | None = None,
    priors: Mapping[str, Prior] | None = None,
    weights: str | Mapping[str, float] = 'equal',
    folded: bool = True,
    stride: int = 1,
    sampling_offset: bool | float = True,
    begins: str = 'auto',
    zero: str = 'auto',
    count: int | None = None,
    max_evaluations: int = 200,
    workers: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a chain to records by free-run least squares, with start values from the data.

    A first fit uses initial conditions guessed from the records. With its model, initial
    condition, zero and weight of each record are estimated, and the fit is repeated.

    Parameters
    ----------
    model, records, free, priors, weights, folded, stride, sampling_offset, workers
        See `fit`, also for `progress`; the rest as in `refined`.
    start : mapping of str to float, optional
        Known start values; the others are determined from the data. May hold ``sampling_offset``.
    guesses : sequence of mapping of str to float
        More start values, of every unknown, in addition to those from the data.
    begins, zero : str
        Initial conditions and zeros of the records, see `revision.RecordAssumptions`.
    count : int, optional
        Number of start values that are fitted coarsely; the best is refined. The default takes
        about a second (4 to 16 start values).
    max_evaluations : int
        Limit of the final fit; each coarse fit has a sixth of it.
    stopped : callable
        Returns True to stop before the next step; the best result so far is returned.

    Returns
    -------
    FitResult
        Result of the best start.

    Raises
    ------
    IdentificationError
        If there is nothing to fit.
    """
    if not records:
        raise IdentificationError('there is no record to fit; give at least one')
    chain = suited(model, records)
    slow = any(block.slot == Slot.SLOW for block in chain.blocks)
    choices = RecordAssumptions(begins, zero)
    targets = targets_of(
        records,
        folded=folded and not slow,
        stride=stride,
        start=begins,
        zero=zero,
        workers=workers,
    )
    names = tuple(chain.free_names if free is None else free)
    few = representative(targets, _FOLLOWED_RECORDS)
    if count is None:
        samples = sum(t.voltage.size for t in few)
        count = int(np.clip(_FOLLOWED_SAMPLES // samples, 4, 16))
    known = dict(start or {})
    offsets = _offsets(known.pop(SAMPLING_OFFSET, None), sampling_offset, targets)
    if set(names) <= set(known):
        # a known model allows estimating the initial conditions before the fit
        given = {**chain.defaults(), **known}
        targets = estimate_nuisances(chain, given, offsets[0], targets, records, choices)
        few = representative(targets, _FOLLOWED_RECORDS)

    common: dict[str, Any] = {
        'free': names, 'priors': priors, 'weights': weights,
        'sampling_offset': sampling_offset, 'workers': workers, 'stopped': stopped,
    }  # fmt: skip
    late = {SAMPLING_OFFSET: offsets[0]}
    guessed = [Start({**chain.defaults(), **late, **guess, **known}, 0.0) for guess in guesses]

    def follow(seen: Sequence[FitData], begins: Sequence[Start]) -> FitResult:
        """Return the best fit, early if it leaves noise or several starts reach one optimum."""
        found: list[FitResult] = []
        for begin in [*guessed, *begins]:
            found.append(
                _attempt(chain, seen, begin.values, max_evaluations=max_evaluations // 6, **common)
            )
            best = min(found, key=lambda each: each.cost)
            same = [each for each in found if each.cost <= _SAME * best.cost]
            if len(same) >= _ENOUGH or leaves_noise(found[-1]) or stopped():
                break
        return best

    def end(seen: Sequence[FitData], best: FitResult) -> FitResult:
        return refined(
            chain, seen, records, _with_offset(best), choices=choices,
            max_evaluations=max_evaluations, progress=progress, **common,
        )  # fmt: skip

    simulated = Simulated()
    scan = partial(starts, chain, free=names, given=known, offsets=offsets, simulated=simulated)
    found = scan(targets=few, count=count, stopped=stopped)
    result = end(targets, follow(few, found))
    if leaves_noise(result) or stopped() or zero != 'auto' or len(few) < 2:
        return result
    # with one common zero, a model fits different zeros of records as a wider loop
    own = [replace(target, own_zero=True) for target in few]
    others = scan(targets=own, count=len(found))
    if not zeros_lie_apart(others[0].cost, found[0].cost):
        return result
    best = follow(own, others)
    # the zeros are estimated first, or the fit would model them as a loop again
    seen = estimate_nuisances(chain, best.values, best.sampling_offset, targets, records, choices)
    other = end(seen, best)
    return other if zeros_lie_apart(_left(other), _left(result)) else result


def _offsets(
    known: float | None, free: bool | float, targets: Sequence[FitData]
) -> tuple[float, ...]:
    """Return the sampling offsets with which start values are scanned [s].

    Unknown, the displacement is sampled before the voltage of the tick acts or a tick later.
    """
    if known is not None:
        return (known,)
    if free is not True:
        return (float(free),)
    return 0.0, min(target.dt for target in targets)


def leaves_noise(result: FitResult) -> bool:
    """Return whether the residual of a fit is no larger than the noise of its records."""
    return _left(result) <= _NOISE


def _left(result: FitResult) -> float:
    """Return the ratio of the mean squares of residual and noise, infinite if unknown."""
    if not np.isfinite(result.cost) or not all(t.noise > 0.0 for t in result.targets):
        return float('inf')
    squares = [result.residuals[t.name] ** 2 * t.repeats / t.noise**2 for t in result.targets]
    return float(np.mean(np.concatenate(squares)))


def refined(
    model: Model,
    targets: Sequence[FitData],
    records: Sequence[Record],
    start: Mapping[str, float],
    *,
    choices: RecordAssumptions,
    sampling_offset: bool | float = True,
    max_evaluations: int = 200,
    workers: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    **options: Any,
) -> FitResult:
    """Fit from one start, alternating with estimates of the nuisances, until these converge.

    The `options` are those of `fit`.
    """
    common = {
        'sampling_offset': sampling_offset, 'max_evaluations': max_evaluations,
        'workers': workers, 'stopped': stopped, **options,
    }  # fmt: skip

    def attempt(seen: Sequence[FitData], values: Mapping[str, float], **more: Any) -> FitResult:
        return _attempt(model, seen, values, **{**common, **more})

    result = attempt(targets, start)
    for _ in range(_REVISIONS):
        if not np.isfinite(result.cost) or stopped():
            return result
        seen = estimate_nuisances(
            model, result.values, result.sampling_offset, targets, records, choices,
            workers=workers,
        )  # fmt: skip
        if all(map(_alike, targets, seen, result.residuals.values())):
            break
        targets = seen
        result = attempt(targets, _with_offset(result))
    if stopped():
        return result
    search = _search(result, records, choices)
    other = search.with_steps(targets)
    if other is not None:
        enough = (1.0 + other[1]) * result.cost
        plain = attempt(other[0], _with_offset(result), enough=enough)
        if plain.cost <= enough:
            targets, result = other[0], plain
    elif (moving := search.in_motion(targets)) is not None:
        found = attempt(moving[0], _with_offset(result))
        if found.cost < moving[1] * result.cost:
            targets, result = moving[0], found
    if sampling_offset is True and result.sampling_offset != 0.0:
        samples = sum(left.size for left in result.residuals.values())
        enough = (1.0 + max(_NO_WORSE, _CHANCE / samples)) * result.cost
        trusted = attempt(targets, result.values, sampling_offset=False, enough=enough)
        if trusted.cost <= enough:
            return trusted
    return result


def with_held_levels(
    found: FitResult, records: Sequence[Record], choices: RecordAssumptions, **options: Any
) -> FitResult:
    """Return a fit that gains nothing from levels before a record that no run reaches.

    A fit removes the linearised response to these levels. A play bounds that response, its
    derivative does not. Where the run from the best levels leaves much more than that promises,
    they are held in a further fit, which counts if its runs have the smaller error. A fit that
    leaves only noise has promised nothing wrong: few levels then stand for a state that they miss.
    """
    clock = True if SAMPLING_OFFSET in found.std else found.sampling_offset
    for _ in range(0 if leaves_noise(found) else _HELD_TURNS):
        held = _search(found, records, choices).held(found.targets, choices.zero)
        if not any(each.begins.held for each in held):
            break
        other = fit(
            found.model, (), _with_offset(found), targets=held, sampling_offset=clock, **options
        )
        before, after = (
            _search(each, records, choices).square_of_runs(held) for each in (found, other)
        )
        if not after < before:
            break
        found = other
        if after > (1.0 - _BETTER) * before:
            break
    return found


def _search(
    found: FitResult, records: Sequence[Record], choices: RecordAssumptions
) -> InitialConditionSelector:
    return InitialConditionSelector(
        found.model, found.values, found.sampling_offset, records, choices.start
    )


def _alike(one: FitData, other: FitData, error: FloatArray) -> bool:
    """Return whether two views of a record give the same fit, for such residuals [m]."""
    if not one.begins_like(other) or one.lost != other.lost:
        return False

    def square(target: FitData) -> float:
        weighted = error if target.influence is None else error * target.influence
        return inner(weighted, weighted) * target.precision**2

    return abs(square(one) - square(other)) <= _ALIKE * square(one)


def _with_offset(result: FitResult) -> dict[str, float]:
    return {**result.values, SAMPLING_OFFSET: result.sampling_offset}


def _attempt(
    model: Model,
    targets: Sequence[FitData],
    values: Mapping[str, float],
    *,
    max_evaluations: int,
    **options: Any,
) -> FitResult:
    # bounds that keep a lightly damped mode off its aliases above half the sampling rate
    half = 0.49 / min(t.dt for t in targets)
    light = values.get('damping_ratio', 1.0) < 0.5
    return fit(
        model,
        (),
        values,
        bounds={'natural_frequency': (0.0, half)} if light else {},
        max_evaluations=max(max_evaluations, 20),
        targets=targets,
        **options,
    )
