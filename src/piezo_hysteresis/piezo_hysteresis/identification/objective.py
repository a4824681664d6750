"""The free-run error of a chain over many records, as a least-squares problem."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import floor, isfinite
from typing import TypeVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification.factor import inner, triangle
from piezo_hysteresis.identification.sensitivities import sensitivities
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import Model

#: Name of the nuisance: by how much later than our convention the displacement was sampled [s].
SAMPLING_OFFSET = 'sampling_offset'

Result = TypeVar('Result')


def shifted(rows: FloatArray, samples: float) -> FloatArray:
    """Return ``rows`` read `samples` later, by cubic interpolation along the last axis.

    Exact for whole samples; the ends repeat their last value.
    """
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


@jit
def _interpolated(rows: FloatArray, first: int, weights: FloatArray) -> FloatArray:
    """Return the weighted sum of four neighbours, the first `first` samples later."""
    n = rows.shape[1]
    total = np.empty_like(rows)
    inside = max(0, min(n, -first))
    outside = max(inside, min(n, n - 3 - first))
    for j in range(rows.shape[0]):
        row = rows[j]
        for k in range(inside, outside):
            i = k + first
            total[j, k] = (
                weights[0] * row[i]
                + weights[1] * row[i + 1]
                + weights[2] * row[i + 2]
                + weights[3] * row[i + 3]
            )
        for part in range(2):
            for k in range(0 if part == 0 else outside, inside if part == 0 else n):
                sum_ = 0.0
                for i in range(4):
                    sum_ += weights[i] * row[min(max(k + first + i, 0), n - 1)]
                total[j, k] = sum_
    return total


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data.

    Attributes
    ----------
    mean, std : float
        In the unit of the parameter.
    """

    mean: float
    std: float


class Objective:
    """Half the weighted sum of squared free-run errors of a model over targets.

    Parameters
    ----------
    model : Model
        Any chain.
    targets : sequence of Target
        What it is compared with.
    free : sequence of str
        Unknowns, in order; may hold `SAMPLING_OFFSET` besides the parameters of the chain.
    values : mapping of str to float
        What the other parameters are fixed at.
    weights : sequence of float
        Factor of each target's residual [1], besides that of its repeats.
    priors : mapping of str to Prior
        Extra knowledge about unknowns.
    noise : float
        Residual [m] that stands for one standard deviation of a prior.
    workers : int
        Threads over the targets; the result does not depend on it.
    """

    def __init__(
        self,
        model: Model,
        targets: Sequence[Target],
        free: Sequence[str],
        values: Mapping[str, float],
        *,
        weights: Sequence[float] | None = None,
        priors: Mapping[str, Prior] | None = None,
        noise: float = 0.0,
        workers: int = 1,
    ) -> None:
        self.model = model
        self.targets = tuple(targets)
        self.free = tuple(free)
        self.weights = tuple(1.0 for _ in targets) if weights is None else tuple(weights)
        self._fixed = dict(values)
        self._own = tuple(name for name in free if name != SAMPLING_OFFSET)
        self._priors = [
            (self.free.index(name), prior.mean, noise / prior.std)
            for name, prior in (priors or {}).items()
            if name in self.free
        ]
        self._workers = min(workers, len(self.targets))

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return every parameter of the chain, and the sampling offset, at the point `x`."""
        return {**self._fixed, **dict(zip(self.free, (float(v) for v in x), strict=True))}

    def packed(self, x: FloatArray) -> FloatArray:
        """Return the parameters of the chain at `x`; ModelError where they are impossible."""
        values = self.values(x)
        values.pop(SAMPLING_OFFSET, None)
        return self.model.pack(values)

    def simulate(self, target: Target, x: FloatArray, packed: FloatArray) -> FloatArray:
        """Return what the model says about the samples of `target` [m]."""
        y = self.model.respond(
            target.voltage,
            packed,
            target.dt,
            state=self.model.initial_state(target.dt, target.start),
            frequency=target.frequency,
        )
        late = self.values(x).get(SAMPLING_OFFSET, 0.0)
        return target.pick(shifted(y, late / target.dt) if late else y)

    def residuals(self, x: FloatArray) -> list[FloatArray]:
        """Return measured minus simulated of every target [m], without weights."""
        packed = self.packed(x)
        return self._map(lambda t: t.measured - self.simulate(t, x, packed))

    def cost(self, x: FloatArray) -> float:
        """Half the weighted sum of squares at `x`; inf where `x` is impossible."""
        try:
            packed = self.packed(x)
        except ModelError:
            return float('inf')

        def square(target: Target) -> float:
            # parameters may make the model overflow: then they are impossible, not an error
            with np.errstate(over='ignore', invalid='ignore'):
                error = target.measured - self.simulate(target, x, packed)
                return inner(error, error)

        squares = self._map(square)
        total = sum(
            (t.weight * w) ** 2 * s
            for t, w, s in zip(self.targets, self.weights, squares, strict=True)
        )
        total += sum(((x[j] - mean) * scale) ** 2 for j, mean, scale in self._priors)
        return 0.5 * total if isfinite(total) else float('inf')

    def jacobian(self, target: Target, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return simulated samples, shape (m,), and derivatives, shape (p, m), of a target."""
        y, rows = sensitivities(
            self.model,
            self.packed(x),
            self._own,
            target.voltage,
            target.dt,
            target.frequency,
            target.start,
        )
        late = self.values(x).get(SAMPLING_OFFSET, 0.0) / target.dt
        if SAMPLING_OFFSET in self.free:
            slope = (shifted(y, late + 1e-4) - shifted(y, late - 1e-4)) / (2e-4 * target.dt)
            place = self.free.index(SAMPLING_OFFSET)
            rows = np.insert(shifted(rows, late) if late else rows, place, slope, axis=0)
        elif late:
            rows = shifted(rows, late)
        y = shifted(y, late) if late else y
        return target.pick(y), rows[:, target.first :: target.stride]

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return R, Q'r and the cost at `x`, see `solver.Problem`."""
        p = len(self.free)
        try:
            self.packed(x)
        except ModelError:
            return np.eye(p), np.zeros(p), float('inf')

        def compress(pair: tuple[Target, float]) -> FloatArray:
            target, weight = pair
            with np.errstate(over='ignore', invalid='ignore'):
                y, rows = self.jacobian(target, x)
                stacked = np.vstack([rows, y - target.measured]) * (weight * target.weight)
            if not np.all(np.isfinite(stacked)):
                return np.full((p + 1, p + 1), np.inf)
            return triangle(stacked)

        blocks = self._map(compress, list(zip(self.targets, self.weights, strict=True)))
        for j, mean, scale in self._priors:
            row = np.zeros((1, p + 1))
            row[0, j], row[0, p] = scale, (x[j] - mean) * scale
            blocks.append(row)
        stacked = np.vstack(blocks)
        if not np.all(np.isfinite(stacked)):
            return np.eye(p), np.zeros(p), float('inf')
        with np.errstate(over='ignore', invalid='ignore'):
            full = triangle(np.ascontiguousarray(stacked.T))
            cost = 0.5 * float(full[:, p] @ full[:, p])
        if not (np.all(np.isfinite(full)) and isfinite(cost)):
            return np.eye(p), np.zeros(p), float('inf')
        return full[:p, :p], full[:p, p], cost

    def _map(
        self, function: Callable[..., Result], items: Sequence[object] | None = None
    ) -> list[Result]:
        work = self.targets if items is None else items
        if self._workers <= 1:
            return [function(each) for each in work]
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(function, work))
