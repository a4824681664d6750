"""What a model says a record should read: the one free run behind every comparison with data.

One clock for all models: ``displacement[k]`` is measured before ``voltage[k]`` acts. A chain whose
structure has inertia answers so by itself; one that answers at once is read a tick later. By how
much the clock of a recording is off besides is its sampling offset, a nuisance of the data.
"""

from __future__ import annotations

from dataclasses import replace
from math import floor

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.factor import inner
from piezo_hysteresis.identification.record_start import path_to
from piezo_hysteresis.identification.sensitivities import sensitivities
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import Model, answers_at_once
from piezo_hysteresis.models.stages import free_states
from piezo_hysteresis.numerics.linalg import solve_square

# A state at the start is moved by this share of the stroke to see what it does.
_NUDGE = 1e-2
# And a level of the voltage before it by this share of the largest.
_LEVEL = 3e-3
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


def start_rows(
    model: Model, packed: FloatArray, target: Target, sampling_offset: float = 0.0
) -> FloatArray:
    """Return what the unknown states at the start of a record do to its samples, shape (q, m).

    Every state of the dynamics (position and velocity of a mode, elements of creep, a lag) is
    moved a little where the record begins, and so is every level of the voltage before it, which
    the memory still knows; what follows is a transient that no parameter explains. Each row has
    the largest absolute value 1 [m].
    """
    if target.begins.kind != 'estimate':
        return np.empty((0, target.measured.size))
    late = samples_late(model, packed, target.dt, sampling_offset)

    def after(levels: tuple[float, ...]) -> list[FloatArray]:
        start = replace(target.begins, levels=levels)
        before = path_to(target.voltage[target.origin : target.origin + 2], start, target.dt)
        state = model.initial_state(target.dt, target.start)
        model.respond(before, packed, target.dt, state=state, frequency=target.frequency)
        return state

    def run(state: list[FloatArray]) -> FloatArray:
        drive = target.voltage[target.origin :]
        y = model.respond(drive, packed, target.dt, state=state, frequency=target.frequency)
        return np.concatenate([np.full(target.origin, y[0]), y])

    stroke = float(np.ptp(target.measured)) or 1.0
    levels, begun = target.begins.levels, after(target.begins.levels)
    usual = run([each.copy() for each in begun])
    moved = []
    for k, stage in enumerate(model.stages):
        for place in free_states(stage, target.dt):
            state = [each.copy() for each in begun]
            state[k][place] += _NUDGE * stroke
            moved.append(run(state))
    reach = _LEVEL * float(np.max(np.abs(target.voltage)))
    for k, level in enumerate(levels):
        moved.append(run(after((*levels[:k], level + reach, *levels[k + 1 :]))))
    rows = []
    for each in moved:
        row = target.pick(shifted(each - usual, late))
        size = float(np.max(np.abs(row), initial=0.0))
        if np.isfinite(size) and size > 1e-9 * _NUDGE * stroke:
            rows.append(row / size)
    return np.array(rows).reshape(len(rows), target.measured.size)


def nuisance_rows(
    model: Model, packed: FloatArray, target: Target, sampling_offset: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return what is known of a record from itself alone, and how firmly it is held to 0.

    Returns
    -------
    rows : ndarray, shape (q, m)
        Of the states at its start and of its own zero.
    prior : ndarray, shape (q,)
        Rows of a prior: a start lies within the stroke, a zero anywhere.
    """
    rows = start_rows(model, packed, target, sampling_offset)
    stroke = float(np.ptp(target.measured)) or 1.0
    noise = target.noise if np.isfinite(target.noise) else _UNKNOWN_NOISE * stroke
    prior = np.full(len(rows), noise / stroke)
    if target.own_zero:
        rows = np.vstack([rows, np.ones(target.measured.size)])
        prior = np.append(prior, 0.0)
    return rows, prior


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
    rows, prior = nuisance_rows(model, packed, target, sampling_offset)
    if not len(rows):
        return error, error
    if factors is not None:
        rows = rows * factors
    gram = rows @ rows.T + np.diag(prior**2)
    return error, np.asarray(error - solve_square(gram, rows @ error).values @ rows)
