"""Elimination of the nuisance parameters of one record (variable projection).

Initial state, voltage levels before the record, the zero of the record and the input held before
its first sample are at their best fit for every value of the model parameters, so that a fit has
only the model parameters as unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import samples_late, shifted
from piezo_hysteresis.identification.initial_conditions.initial_state import (
    BestFit,
    InitialStateRun,
    level_rows,
    start_rows,
)
from piezo_hysteresis.identification.sensitivities import StateOffset
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.qr import inner

# Ratio of noise to stroke that a prior assumes if the noise of a record is unknown.
_UNKNOWN_NOISE = 1e-3
# Largest number of iterations of the initial states, and the negligible share of a cost decrease.
_TURNS = 4
_SMALL = 1e-6
# Shares of a step of the states of a loop, tried until one reduces the error of the run: 0 moves
# only states to which the response is linear.
_PARTS = (1.0, 0.3, 0.0)


@dataclass(frozen=True)
class Nuisances:
    """Nuisance parameters of one record at their optimum for one model."""

    rows: FloatArray  # derivatives by the nuisance parameters, shape (q, m)
    prior: FloatArray  # weight of the prior about 0, shape (q,)
    motion: InitialStateRun | None = None  # run from the estimated initial state
    pull: FloatArray = field(default_factory=lambda: np.empty(0))  # (q,)
    levels: tuple[float, ...] = ()  # estimated levels before the record [V]
    explained: BestFit | None = None  # least squares on the weighted rows
    first: tuple[int, ...] = ()  # compared samples with a parameter each, see `_first_samples`


def nuisances_of(
    model: Model,
    packed: FloatArray,
    target: FitData,
    sampling_offset: float = 0.0,
    factors: FloatArray | None = None,  # (m,)
) -> Nuisances:
    """Return the nuisance parameters of a record at their optimum, see `Nuisances`."""
    if target.shared is not None:
        return Nuisances(*target.shared, pull=np.zeros(len(target.shared[1])))
    if target.begins.kind != 'estimate':
        own = np.ones((int(target.own_zero), target.measured.size))
        return Nuisances(own, np.zeros(len(own)), pull=np.zeros(len(own)))
    late = samples_late(model, target.dt, sampling_offset)
    motion = InitialStateRun(model, packed, target)

    def left() -> FloatArray:
        return target.measured - target.pick(shifted(motion.response, late))

    error = left()
    if not np.all(np.isfinite(error)):
        return Nuisances(np.empty((0, error.size)), np.empty(0), motion)
    states, most = start_rows(motion)
    rows = [target.pick(shifted(row, late)) for row in (*states, *level_rows(motion))]
    first = _first_samples(target, late)
    rows += [np.eye(1, error.size, place)[0] for place in first]
    stroke = float(np.ptp(target.measured)) or 1.0
    noise = target.noise if isfinite(target.noise) else _UNKNOWN_NOISE * stroke
    prior = [noise] * len(rows)
    if target.own_zero:
        rows.append(np.ones(error.size))
        prior.append(0.0)
    stacked = np.array(rows).reshape(len(rows), error.size)
    nuisances = Nuisances(stacked, np.array(prior), motion, first=first)
    return _settled(nuisances, most, left, factors)


def _first_samples(target: FitData, late: float) -> tuple[int, ...]:
    """Return the compared samples that depend on the input held before the record."""
    driven = range(target.origin, target.origin + max(ceil(-late), 0))
    pairs = (divmod(sample - target.first, target.stride) for sample in driven)
    return tuple(place for place, off in pairs if place >= 0 and off == 0)


def _settled(
    nuisances: Nuisances,
    most: Sequence[StateOffset],
    left: Callable[[], FloatArray],
    factors: FloatArray | None,
) -> Nuisances:
    """Iterate the initial states to their optimum by Gauss-Newton steps.

    A step counts by the error of the run that it leads to. Its linearisation is exact for a mode,
    not for a loop. Levels before the record are not moved here, see `InitialConditionSelector`.
    """
    assert nuisances.motion is not None
    motion, weight = nuisances.motion, 1.0 if factors is None else factors
    rows = nuisances.rows if factors is None else nuisances.rows * factors
    begins, prior, states = motion.target.begins, nuisances.prior, len(most)
    known = () if begins.held else begins.levels
    straight = np.array([motion.in_proportion(each) for each in most], bool)
    moves = np.ones(len(rows), bool)
    moves[states : states + len(known)] = False
    exact = moves.copy()
    exact[:states] = straight
    explained = BestFit(rows, prior)

    def evaluated(shares: FloatArray) -> tuple[float, FloatArray]:
        """Return the cost of the run from these offsets, and its error."""
        error = left() * weight
        if not np.all(np.isfinite(error)):
            return float('inf'), error
        more = explained(error, shares, exact)
        rest, held = error - more @ rows, prior * (shares + more)
        return inner(rest, rest) + float(held @ held), error

    shares = np.zeros(len(rows))
    cost, error = evaluated(shares)
    bent = not np.all(straight)  # else the cost of the best states is known without their run
    for _ in range(_TURNS if bent and isfinite(cost) else 0):
        step, before, found = explained(error, shares, moves), motion.moved, None
        step[states:] = 0.0
        for part in _PARTS:
            moved = shares + step * np.where(exact, 1.0, part)
            motion.go(_amounts(most, moved))
            new, further = evaluated(moved)
            if new <= cost * (1.0 + 1e-9):
                found = moved
                break
        if found is None:
            motion.go(before)
            break
        gain, cost, shares, error = cost - new, new, found, further
        if gain <= _SMALL * cost:
            break
    if states and isfinite(cost):
        shares += explained(error, shares, exact)
        shares[states:] = 0.0
        motion.go(_amounts(most, shares))
        error = left() * weight
    levels: tuple[float, ...] = ()
    if known and np.all(np.isfinite(error)):
        largest = float(np.max(np.abs(motion.target.voltage)))
        more = explained(error, shares)[states : states + len(known)]
        levels = tuple(a + largest * float(b) for a, b in zip(known, more, strict=True))
    return replace(nuisances, pull=shares, levels=levels or begins.levels, explained=explained)


def _amounts(most: Sequence[StateOffset], shares: FloatArray) -> tuple[StateOffset, ...]:
    """Return offsets of the initial state as shares of the largest ones."""
    return tuple(
        each._replace(amount=each.amount * float(share))
        for each, share in zip(most, shares, strict=False)
    )
