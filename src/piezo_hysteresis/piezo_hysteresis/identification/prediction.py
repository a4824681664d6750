"""Prediction of one record by a model: response, residual, cost and initial state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import InverseRole
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import (
    Derivatives,
    StageCache,
    differentiated,
    read,
    samples_late,
    simulated,
)
from piezo_hysteresis.identification.initial_conditions.initial_state import BestFit
from piezo_hysteresis.identification.initial_conditions.nuisances import Nuisances, nuisances_of
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.chain import State
from piezo_hysteresis.numerics.qr import inner

# Invalid parameters may make a model overflow; their cost is infinite and needs no warning.
_quiet = partial(np.errstate, over='ignore', invalid='ignore')


class Prediction:
    """The free run of a model over a target, with its nuisance parameters at their optimum."""

    def __init__(
        self,
        model: Model,
        packed: FloatArray,  # (p,)
        target: FitData,
        sampling_offset: float = 0.0,  # [s]
        *,
        weighted: bool = False,
        cache: StageCache | None = None,
    ) -> None:
        self._model, self._packed, self._cache = model, packed, cache
        self.target, self._offset = target, sampling_offset
        self._factors = target.factors if weighted else target.valid
        #: Nuisance parameters of the record, see `Nuisances`.
        self.nuisances: Nuisances
        with _quiet():
            self.nuisances = nuisances_of(model, packed, target, sampling_offset, self._factors)

    @cached_property
    def response(self) -> FloatArray:
        """Displacement at every tick of the drive, lead-in included, shape (n,) [m]."""
        run = self.nuisances.motion
        late = samples_late(self._model, self.target.dt, self._offset)
        with _quiet():
            if run is None:
                return simulated(self._model, self._packed, self.target, self._offset, self._cache)
            return read(run.response, self.target, late)

    @property
    def zero(self) -> float:
        """Mean of the measured displacement beyond the response [m]."""
        view, first = self.target, self.nuisances.first
        if first:
            valid = np.ones(view.measured.size) if view.valid is None else view.valid.copy()
            valid[list(first)] = 0.0
            view = replace(view, valid=valid)
        with _quiet():
            return float(np.mean(view.kept(view.measured - view.pick(self.response))))

    @cached_property
    def _placed(self) -> FloatArray:
        """Response in the zero of the record, lead-in included [m].

        A sample that depends on the unknown input before the record is itself a nuisance
        parameter: its best fit is the measured one.
        """
        placed = self.response + self.zero if self.target.own_zero else self.response
        if first := list(self.nuisances.first):
            placed = placed.copy()
            placed[self.target.compared][first] = self.target.measured[first]
        return placed

    @property
    def displacement(self) -> FloatArray:
        """Displacement from the first sample of the record on, in the zero of the record [m]."""
        return self._placed[self.target.origin :]

    @cached_property
    def error(self) -> FloatArray:
        """Measured minus `displacement`, of all samples, the excluded ones included [m]."""
        return self.target.measured - self.target.pick(self._placed)

    @property
    def valid_error(self) -> FloatArray:
        """Measured minus `displacement`, shape (m,) [m]; 0 where a sample is excluded."""
        valid = self.target.valid
        return self.error if valid is None else self.error * valid

    @property
    def residual(self) -> FloatArray:
        """Residual of a fit: the nuisances projected out by their derivatives, shape (m,) [m].

        It is 0 where a sample is lost, and smaller than `error` where the response to a nuisance
        is not linear.
        """
        error, _ = self._split
        return error if self._factors is None else error * self._factors

    @property
    def cost(self) -> float:
        """Sum of squares that a fit minimises, including the prior of the nuisances [m^2]."""
        residual, held = self.residual, self._split[1]
        with _quiet():
            return inner(residual, residual) + float(held @ held)

    @cached_property
    def _split(self) -> tuple[FloatArray, FloatArray]:
        """Error with all nuisances at their optimum, and the residual of their prior [m]."""
        nuisances, factors = self.nuisances, self._factors
        with _quiet():
            error, rows = self.target.measured - self.target.pick(self.response), nuisances.rows
            if not len(rows) or not np.all(np.isfinite(error)):
                return error, np.zeros(0)
            weight = 1.0 if factors is None else factors
            explained = nuisances.explained or BestFit(rows * weight, nuisances.prior)
            more = explained(error * weight, nuisances.pull)
            return error - more @ rows, nuisances.prior * (nuisances.pull + more)

    def derivatives(self, free: tuple[str, ...]) -> Iterator[Derivatives]:
        """Yield the response and its derivatives, see `free_run.differentiated`."""
        return differentiated(
            self._model, self._packed, free, self.target, self._offset, self.nuisances.motion
        )

    def initial_state(self) -> tuple[State, FloatArray]:
        """Return the state of the chain at the first sample, and its output until then [m]."""
        target = self.target
        state = self._model.initial_state(target.dt, target.start)
        before = np.ascontiguousarray(target.voltage[: target.origin])
        answer = self._model.respond(
            before, self._packed, target.dt, state=state, frequency=target.frequency
        )
        for each in self.nuisances.motion.moved if self.nuisances.motion else ():
            state[each.stage][each.place] += each.amount
        return state, answer


def predictions(
    model: Model,
    values: Mapping[str, float],
    views: Sequence[FitData],
    sampling_offset: float = 0.0,  # [s]
    *,
    checked: bool = True,
) -> Iterator[Prediction]:
    """Yield the prediction of each whole record by a model."""
    packed = model.pack(values, checked=checked)
    for view in views:
        yield Prediction(model, packed, view, sampling_offset)


def with_mean_zero(
    model: Model,
    values: Mapping[str, float],
    views: Sequence[FitData],
    sampling_offset: float = 0.0,  # [s]
) -> dict[str, float]:
    """Return the values of a model, with the mean zero of records that have a zero of their own.

    A fit with one zero per record leaves the zero of the model where it was, which may be
    anywhere; a compensator needs that of the records.
    """
    zeros = model.zero_names - set(model.held)
    last = model.blocks[-1].role is InverseRole.ZERO
    if not views or len(zeros) != 1 or not last or not all(view.own_zero for view in views):
        return dict(values)
    runs = predictions(model, values, views, sampling_offset, checked=False)
    (name,) = zeros
    moved = values[name] + float(np.mean([run.zero for run in runs]))
    return {**values, name: moved} if np.isfinite(moved) else dict(values)
