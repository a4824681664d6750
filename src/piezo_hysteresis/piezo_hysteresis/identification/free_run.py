"""Free run of a model at the sampling times of a record, for every comparison with data.

All models use one convention: ``displacement[k]`` is measured before ``voltage[k]`` acts. A chain
with inertia responds accordingly; a chain without inertia is read a tick later. Any further delay
of a recording is its sampling offset, a nuisance parameter of the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.initial_state import InitialStateRun
from piezo_hysteresis.identification.sensitivities import SensitivityRun
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.plan import TickStage
from piezo_hysteresis.numerics.qr import BLOCK


def shifted(rows: FloatArray, samples: float) -> FloatArray:
    """Return ``rows`` read `samples` later, by cubic interpolation along the last axis.

    Exact for whole samples; the ends repeat their last value.
    """
    if samples == 0.0:
        return rows
    whole = floor(samples)
    f = samples - whole
    weights = np.array(
        [
            -f * (f - 1) * (f - 2) / 6,
            (f + 1) * (f - 1) * (f - 2) / 2,
            -(f + 1) * f * (f - 2) / 2,
            (f + 1) * f * (f - 1) / 6,
        ]
    )
    flat = np.ascontiguousarray(np.atleast_2d(rows), dtype=np.float64)
    return _interpolated(flat, whole - 1, weights).reshape(rows.shape)


def read(rows: FloatArray, target: FitData, samples: float) -> FloatArray:
    """Return responses to the drive of a target read `samples` later, shape (..., n)."""
    return shifted(rows, samples)[..., : target.voltage.size]


@jit
def _interpolated(rows: FloatArray, first: int, weights: FloatArray) -> FloatArray:
    """Return the weighted sum of four neighbours, the first `first` samples later."""
    n = rows.shape[1]
    total = np.empty_like(rows)
    inside = max(0, min(n, -first))
    outside = max(inside, min(n, n - 3 - first))
    # slices are never negative; with index arithmetic Numba tests each index, six times slower
    begin, end = inside + first, outside + first
    for j in range(rows.shape[0]):
        row, found = rows[j], total[j, inside:outside]
        one, two = row[begin:end], row[begin + 1 : end + 1]
        three, four = row[begin + 2 : end + 2], row[begin + 3 : end + 3]
        for k in range(found.size):
            found[k] = (
                weights[0] * one[k]
                + weights[1] * two[k]
                + weights[2] * three[k]
                + weights[3] * four[k]
            )
        for part in range(2):
            for k in range(0 if part == 0 else outside, inside if part == 0 else n):
                sum_ = 0.0
                for i in range(4):
                    sum_ += weights[i] * row[min(max(k + first + i, 0), n - 1)]
                total[j, k] = sum_
    return total


def samples_late(model: Model, dt: float, sampling_offset: float = 0.0) -> float:
    """Return the delay of the measurement relative to the response of the chain, in samples."""
    # dt, sampling_offset [s]
    ahead = model.answers_at_once
    return sampling_offset / dt - (1.0 if ahead else 0.0)


class StageCache:
    """Cache of the simulated stages of a model, reused by models with the same first stages."""

    def __init__(self, model: Model, packed: FloatArray, targets: Sequence[FitData]) -> None:
        # packed (p,)
        self._stages, self._packed = model.stages, packed
        self._signals: dict[int, list[FloatArray]] = {}
        self._targets = tuple(targets)  # the id of a collected object can be reused
        for target in targets:
            states, signal = model.initial_state(target.dt, target.start), target.drive
            known = self._signals[id(target)] = [signal]
            for stage, state in zip(model.stages, states, strict=True):
                if not isinstance(stage, TickStage):
                    break
                p = packed[stage.columns]
                signal = stage.respond(
                    signal, p, target.dt, state=state, frequency=target.frequency
                )
                known.append(signal)

    def of(self, model: Model, packed: FloatArray, target: FitData) -> tuple[int, FloatArray]:
        """Return the first stage of a model that is not cached, and its input."""
        known, first = self._signals.get(id(target), [target.drive]), 0
        for mine, other in zip(self._stages[: len(known) - 1], model.stages, strict=False):
            if not (isinstance(mine, TickStage) and isinstance(other, TickStage)):
                break
            if mine.block is not other.block or mine.ahead is not other.ahead:
                break
            if not np.array_equal(self._packed[mine.columns], packed[other.columns]):
                break
            first += 1
        return first, known[first]


def simulated(
    model: Model,
    packed: FloatArray,
    target: FitData,
    sampling_offset: float = 0.0,
    cache: StageCache | None = None,
) -> FloatArray:
    """Return the simulated displacement at each tick of the drive of `target` [m], shape (n,)."""
    first, drive = (0, target.drive) if cache is None else cache.of(model, packed, target)
    y = model.respond(
        drive,
        packed,
        target.dt,
        state=model.initial_state(target.dt, target.start),
        frequency=target.frequency,
        first=first,
    )
    return read(y, target, samples_late(model, target.dt, sampling_offset))


class Derivatives(NamedTuple):
    """Simulated displacement and its derivatives over a part of the samples of a target."""

    first: int  # first driven sample
    displacement: FloatArray  # as `simulated` [m], shape (n,)
    rows: FloatArray  # derivatives by the parameters [m per unit], shape (p, n)
    slope: FloatArray  # derivative by the sampling offset [m/s], shape (n,)


def differentiated(
    model: Model,
    packed: FloatArray,
    free: tuple[str, ...],
    target: FitData,
    sampling_offset: float = 0.0,
    motion: InitialStateRun | None = None,
) -> Iterator[Derivatives]:
    """Yield the simulated displacement and its derivatives, block by block of samples.

    The memory is that of a block for any length of the record.
    """
    run = SensitivityRun(
        model, packed, free, target.dt, target.frequency, target.start,
        origin=target.origin, offsets=() if motion is None else motion.moved,
    )  # fmt: skip
    late = samples_late(model, target.dt, sampling_offset)
    drive, end = target.drive, target.voltage.size
    reach = ceil(abs(late)) + 4  # samples on either side that the interpolation takes
    y, rows, begin, done = np.empty(0), np.empty((len(free), 0)), 0, 0
    for first in range(0, drive.size, BLOCK):
        last = min(first + BLOCK, drive.size)
        more, further = run.advance(drive[first:last])
        more = more if motion is None else motion.response[first:last]
        y = np.concatenate([y, more]) if begin < first else more
        rows = np.concatenate([rows, further], axis=1) if begin < first else further
        ready = end if last == drive.size else min(last - reach, end)
        if ready > done:
            here = slice(done - begin, ready - begin)
            slope = (shifted(y, late + 1e-4) - shifted(y, late - 1e-4)) / (2e-4 * target.dt)
            yield Derivatives(
                done, shifted(y, late)[here], shifted(rows, late)[:, here], slope[here]
            )
            done = ready
        kept = max(done - reach, begin)
        y, rows, begin = y[kept - begin :], rows[:, kept - begin :], kept
