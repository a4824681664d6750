"""What a model says a record should read: the one free run behind every comparison with data.

One clock for all models: ``displacement[k]`` is measured before ``voltage[k]`` acts. A chain whose
structure has inertia answers so by itself; one that answers at once is read a tick later. By how
much the clock of a recording is off besides is its sampling offset, a nuisance of the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.factor import inner
from piezo_hysteresis.identification.sensitivities import sensitivities
from piezo_hysteresis.identification.start_response import StartResponse
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import Model, answers_at_once
from piezo_hysteresis.numerics.linalg import solve_square

# Noise against the stroke that a prior assumes where the noise of a record is not known.
_UNKNOWN_NOISE = 1e-3


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


def samples_late(
    model: Model, packed: FloatArray, dt: float, sampling_offset: float = 0.0
) -> float:
    """Return how many samples later than the chain answers a recording reads it.

    Parameters
    ----------
    model : Model
        The chain.
    packed : ndarray, shape (p,)
        Its parameters.
    dt, sampling_offset : float
        Sampling interval, and how much later than our convention the displacement was read [s].
    """
    ahead = answers_at_once(model, model.unpack(packed), dt)
    return sampling_offset / dt - (1.0 if ahead else 0.0)


def simulated(
    model: Model, packed: FloatArray, target: Target, sampling_offset: float = 0.0
) -> FloatArray:
    """Return what the model says at every tick of the drive of `target` [m], shape (n,)."""
    y = model.respond(
        target.voltage,
        packed,
        target.dt,
        state=model.initial_state(target.dt, target.start),
        frequency=target.frequency,
    )
    return shifted(y, samples_late(model, packed, target.dt, sampling_offset))


def differentiated(
    model: Model,
    packed: FloatArray,
    free: tuple[str, ...],
    target: Target,
    sampling_offset: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the model says, and its derivatives.

    Returns
    -------
    displacement : ndarray, shape (n,)
        As `simulated` [m].
    rows : ndarray, shape (len(free), n)
        Derivatives by the parameters [m per unit].
    slope : ndarray, shape (n,)
        Derivative by the sampling offset [m/s].
    """
    y, rows = sensitivities(
        model, packed, free, target.voltage, target.dt, target.frequency, target.start
    )
    late = samples_late(model, packed, target.dt, sampling_offset)
    slope = (shifted(y, late + 1e-4) - shifted(y, late - 1e-4)) / (2e-4 * target.dt)
    return shifted(y, late), shifted(rows, late), slope


class Nuisances:
    """What is known of a record from itself alone: the states at its start, and its own zero.

    Parameters
    ----------
    model, packed, target, sampling_offset
        As in `simulated`.

    Attributes
    ----------
    rows : ndarray, shape (q, m)
        What each does to the samples that lies where it may be expected at most [m].
    prior : ndarray, shape (q,)
        How firmly each is held to 0, as rows of a prior [m]: a zero lies anywhere.
    """

    def __init__(
        self, model: Model, packed: FloatArray, target: Target, sampling_offset: float = 0.0
    ) -> None:
        size = target.measured.size
        self._factors = target.factors
        self._start: StartResponse | None = None
        self.rows = np.empty((0, size))
        if target.begins.kind == 'estimate':
            late = samples_late(model, packed, target.dt, sampling_offset)
            self._start = StartResponse(
                model, packed, target, lambda y: target.pick(shifted(y, late))
            )
            self.rows = self._start.rows
        noise = target.noise
        if not np.isfinite(noise):
            noise = _UNKNOWN_NOISE * (float(np.ptp(target.measured)) or 1.0)
        self.prior = np.full(len(self.rows), noise)
        if target.own_zero:
            self.rows = np.vstack([self.rows, np.ones(size)])
            self.prior = np.append(self.prior, 0.0)

    def shares(
        self, error: FloatArray, factors: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return how much of each row an error holds, and the rows times the `factors` of it.

        Parameters
        ----------
        error : ndarray, shape (m,)
            Measured less simulated, times the factors [m].
        factors : ndarray, shape (m,), optional
            Weight of each sample.
        """
        rows = self.rows if factors is None else self.rows * factors
        gram = rows @ rows.T + np.diag(self.prior**2)
        return solve_square(gram, rows @ error).values, rows

    def slopes(self, free: Sequence[str], error: FloatArray) -> FloatArray:
        """Return how what the start does moves with the parameters, shape (len(free), m).

        Parameters
        ----------
        free : sequence of str
            Parameters.
        error : ndarray, shape (m,)
            Measured less simulated, times the influence that each sample has [m].
        """
        if self._start is None or not len(self.rows) or not np.all(np.isfinite(error)):
            return np.zeros((len(free), error.size))
        return self._start.slopes(free, self.shares(error, self._factors)[0])


def misfit(
    model: Model,
    packed: FloatArray,
    target: Target,
    sampling_offset: float = 0.0,
    *,
    weighted: bool = False,
) -> FloatArray:
    """Return measured less simulated of a target, its nuisances at their best, shape (m,) [m].

    Lost samples are 0.

    Parameters
    ----------
    model, packed, target, sampling_offset
        As in `simulated`.
    weighted : bool
        Times the influence that each residual has in a fit.
    """
    return _split(model, packed, target, sampling_offset, weighted=weighted)[1]


def square(
    model: Model, packed: FloatArray, target: Target, sampling_offset: float = 0.0
) -> float:
    """Return what a fit makes small of a target [m^2].

    The weighted squares that are left with the nuisances at their best, and what the prior of
    the nuisances charges for these: `misfit` alone would leave the latter out.
    """
    plain, left = _split(model, packed, target, sampling_offset, weighted=True)
    return inner(plain, left)


def _split(
    model: Model,
    packed: FloatArray,
    target: Target,
    sampling_offset: float,
    *,
    weighted: bool,
) -> tuple[FloatArray, FloatArray]:
    """Return measured less simulated without nuisances, and with them at their best."""
    error = target.measured - target.pick(simulated(model, packed, target, sampling_offset))
    factors = target.factors if weighted else target.valid
    if factors is not None:
        error = error * factors
    if not target.own_zero and target.begins.kind != 'estimate':
        return error, error
    if not np.all(np.isfinite(error)):
        return error, error
    known = Nuisances(model, packed, target, sampling_offset)
    if not len(known.rows):
        return error, error
    shares, rows = known.shares(error, factors)
    return error, np.asarray(error - shares @ rows)
