"""The free-run error of a chain over many records, as a least-squares problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import Derivatives, differentiated
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.qr import extend, triangle

#: Name of the nuisance parameter: delay of the displacement samples [s].
SAMPLING_OFFSET = 'sampling_offset'


@dataclass(frozen=True)
class Prior:
    """Prior of a parameter.

    Attributes
    ----------
    mean, std : float
        In the unit of the parameter.
    """

    mean: float
    std: float


# Largest rate of a mode in a fit, times the sampling interval: five times the sampling rate.
# Records show no faster mode, and the integration of one takes minutes.
_FASTEST = 30.0
# A fit that starts faster, as with a known mode in slow samples, may become this much faster.
_FASTER = 2.0
# Share of a sensitivity below which its remainder is rounding.
_ROUNDING = 1e-8


class Objective:
    """Half the weighted sum of squared free-run errors of a model over targets."""

    def __init__(
        self,
        model: Model,
        targets: Sequence[FitData],
        free: Sequence[str],
        values: Mapping[str, float],
        *,
        weights: Sequence[float] | None = None,  # [1]
        priors: Mapping[str, Prior] | None = None,
        noise: float = 0.0,  # [m]
        workers: int = 1,
    ) -> None:
        self.model = model
        self.targets = tuple(targets)
        self.free = tuple(free)
        self.weights = tuple(1.0 for _ in targets) if weights is None else tuple(weights)
        self._fixed = dict(values)
        self._own = tuple(name for name in free if name != SAMPLING_OFFSET)
        self._own_places = np.array([self.free.index(name) for name in self._own], dtype=int)
        self._priors = [
            (self.free.index(name), prior.mean, noise / prior.std)
            for name, prior in (priors or {}).items()
            if name in self.free
        ]
        self._workers = workers
        tick = min((target.dt for target in self.targets), default=1.0)
        held = delays_by_ticks(model)
        # smallest step of each unknown: a tick for delays of a held signal
        self.minimum_steps = np.array([tick if name in held else 0.0 for name in self.free])
        own = [values.get(each.name, each.default) for each in model.parameters]
        # largest rate of a mode that the fit may reach [1/s]
        self._fastest = max(_FASTEST / tick, _FASTER * model.fastest_rate(np.array(own)))

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return all parameters of the chain, and the sampling offset, at the point `x`."""
        return {**self._fixed, **dict(zip(self.free, x.tolist(), strict=True))}

    def packed(self, x: FloatArray) -> FloatArray:
        """Return the parameters of the chain at `x`; ModelError if they are invalid."""
        values = self.values(x)
        values.pop(SAMPLING_OFFSET, None)
        packed = self.model.pack(values)
        if self.model.fastest_rate(packed) > self._fastest:
            raise ModelError('a mode is far above the sampling rate: sample faster')
        return packed

    def sampling_offset(self, x: FloatArray) -> float:
        """Return the delay of the displacement samples relative to the convention [s]."""
        if SAMPLING_OFFSET in self.free:
            return float(x[self.free.index(SAMPLING_OFFSET)])
        return self._fixed.get(SAMPLING_OFFSET, 0.0)

    def residuals(self, x: FloatArray) -> list[FloatArray]:
        """Return measured minus simulated of every target [m], without weights."""
        packed = self.packed(x)
        late = self.sampling_offset(x)
        return of_each(
            lambda t: Prediction(self.model, packed, t, late).residual, self.targets, self._workers
        )

    def cost(self, x: FloatArray) -> float:
        """Half the weighted sum of squares at `x`; inf if `x` is invalid."""
        try:
            packed = self.packed(x)
        except ModelError:
            return float('inf')

        late = self.sampling_offset(x)

        def left(target: FitData) -> float:
            return Prediction(self.model, packed, target, late, weighted=True).cost

        squares = of_each(left, self.targets, self._workers)
        total = sum(
            (t.weight * w) ** 2 * s
            for t, w, s in zip(self.targets, self.weights, squares, strict=True)
        )
        total += sum(((x[j] - mean) * scale) ** 2 for j, mean, scale in self._priors)
        return 0.5 * total if isfinite(total) else float('inf')

    def jacobian(self, target: FitData, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return simulated samples, shape (m,), and derivatives, shape (p, m), of a target."""
        late = self.sampling_offset(x)
        found = differentiated(self.model, self.packed(x), self._own, target, late)
        parts = [self._placed(target, each)[1:] for each in found]
        y, rows = zip(*parts, strict=True)
        return np.concatenate(y), np.concatenate(rows, axis=1)

    def _placed(self, target: FitData, found: Derivatives) -> tuple[slice, FloatArray, FloatArray]:
        """Return which compared samples a part holds, simulated, and derivatives, (p, m)."""
        inside, here = target.compared_in(found.first, found.first + found.slope.size)
        rows = np.empty((len(self.free), inside.stop - inside.start))
        rows[self._own_places] = found.rows[:, here]
        if SAMPLING_OFFSET in self.free:
            rows[self.free.index(SAMPLING_OFFSET)] = found.slope[here]
        return inside, found.displacement[here], rows

    def _factor(self, found: Prediction) -> FloatArray:
        """Return the triangular factor of nuisances, derivatives and residual of a target.

        The prior of the nuisances accounts for the offsets that the run contains.
        """
        target, nuisances = found.target, found.nuisances
        q, p, factors = len(nuisances.rows), len(self.free), target.factors
        factor = np.zeros((q + p + 1, q + p + 1))
        for part in found.derivatives(self._own):
            inside, y, rows = self._placed(target, part)
            seen = np.vstack([nuisances.rows[:, inside], rows, y - target.measured[inside]])
            if factors is not None:
                seen *= factors[inside]
            extend(factor, seen)
        prior = np.zeros((q + p + 1, q))
        prior[:q] = np.diag(nuisances.prior)
        prior[-1] = nuisances.prior * nuisances.pull
        extend(factor, prior)
        return factor

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return R, Q'r and the cost at `x`, see `solver.Problem`."""
        p = len(self.free)
        try:
            packed = self.packed(x)
        except ModelError:
            return np.eye(p), np.zeros(p), float('inf')

        late = self.sampling_offset(x)

        def compress(pair: tuple[FitData, float]) -> FloatArray:
            target, weight = pair
            with np.errstate(over='ignore', invalid='ignore'):
                found = Prediction(self.model, packed, target, late, weighted=True)
                factor = self._factor(found)
            free = projected(factor, len(found.nuisances.rows))
            return free * (weight * target.weight)

        pairs = list(zip(self.targets, self.weights, strict=True))
        blocks = of_each(compress, pairs, self._workers)
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


def projected(full: FloatArray, q: int) -> FloatArray:  # full (p, p) -> (r, p - q)
    """Return a triangular factor with its first columns projected out of the others."""
    if not q or not np.all(np.isfinite(full)):
        return full[q:, q:]
    left, sizes = full[q:, q:].copy(), np.linalg.norm(full[:, q:], axis=0)
    # a column that the nuisances reproduce (an offset and a zero) has only rounding left, which
    # a solver would treat as a direction: it is set to zero
    alike = np.flatnonzero(np.linalg.norm(left, axis=0) <= _ROUNDING * sizes)
    left[:, alike] = 0.0
    unmoved = np.zeros((alike.size, left.shape[1]))
    unmoved[np.arange(alike.size), alike] = _ROUNDING * sizes[alike]
    return np.vstack([left, unmoved])
