"""Predicted responses of candidates and hidden effects in experiments that have not run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.discovery.detection.limits import NuisanceDirections
from piezo_hysteresis.discovery.detection.statements import view_of
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, errors_of
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.discovery.selection.residual_model import Expectation, expectation
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.identification.simulate import clock_about
from piezo_hysteresis.models import Discrepancy, ModelFile
from piezo_hysteresis.numerics.qr import inner


@dataclass(frozen=True)
class Outlook:
    """An experiment with the prediction of the model in use."""

    experiment: PlannedExperiment
    view: FitData  # the experiment as a view of the fit functions
    answer: FloatArray  # displacement predicted by the model in use [m], shape (n,)
    stroke: float  # range of the predicted displacement, including the conditioning [m]
    expected: Expectation  # expected residual power from noise and known discrepancy
    clock: float  # [s]

    @cached_property
    def slope(self) -> FloatArray:
        """Derivative of the response by a sampling delay [m/s], without its mean."""
        slope = np.gradient(self.answer, self.view.dt)
        return np.asarray(slope - slope.mean())

    def gap(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """Return the difference of two responses beyond the nuisance parameters [m].

        Removed are the mean, because the zero offset of a record is free, and a sampling offset
        within its bounds.
        """
        gap = one - other
        gap = gap - gap.mean()
        size = float(self.slope @ self.slope)
        if size > 0.0:
            late = float(gap @ self.slope) / size
            late = min(max(late, -self.clock), self.clock)
            gap = gap - late * self.slope
        return np.asarray(gap)

    def distance(self, one: FloatArray, other: FloatArray, rows: FloatArray) -> float:
        """Return the distance of a response from another that may adapt, in standard deviations.

        It is the distance of `detection.look_alikes` in a record that is only planned: the
        expected power replaces the spectrum of the residual. Offset and clock are free within
        their bounds, the values of the other model within their uncertainty.
        """
        # one, other [m] (n,); rows [m] (p, n)
        if not (np.all(np.isfinite(one)) and np.all(np.isfinite(other))):
            return np.inf
        whitened = self.expected.whitened
        clock, bounds = whitened(self.slope), (-self.clock, self.clock)
        directions = NuisanceDirections((), clock, bounds, [whitened(row) for row in rows])
        left = directions.remove(whitened(one - other))
        return float(np.sqrt(inner(left, left)))

    def _cost(self, powers: FloatArray) -> float:
        if not np.all(np.isfinite(powers)):
            return np.inf
        known = self.expected.expected
        return self.expected.cost(known + powers) - self.expected.cost(known)

    def smallest_seen(self, gap: FloatArray, sizes: FloatArray, sure: float) -> float:
        """Return the smallest of the ascending `sizes` at which `gap` is detected [1].

        Detected means a new deviation with a loss of log likelihood of at least `sure` [nats].
        """
        powers = self.expected.powers(gap)
        known = self.expected.expected
        for size in sizes:
            more = powers * size**2
            if self.expected.new_deviation(known + more) and self._cost(more) >= sure:
                return float(size)
        return np.inf


def answer_of(spec: ModelSpec, view: FitData) -> FloatArray:
    """Return the response of a model in a view [m]; infinite after divergence."""
    return np.asarray(-errors_of(spec, (view,))[0])


def outlook(
    experiment: PlannedExperiment, given: ModelFile, known: Discrepancy, rate: float
) -> Outlook:
    """Return an experiment with the prediction of the model of a file."""
    view = view_of(experiment, rate, known.noise)
    base = in_use(given)
    answer = answer_of(base, view)
    packed = base.model.pack(base.values)
    whole = simulated(base.model, packed, view, base.sampling_offset)
    stroke = float(np.ptp(whole)) if np.all(np.isfinite(whole)) else np.inf
    known_part = expectation(view, known, max(stroke, 1e-300), HELD)
    clock = clock_about(given, view.dt)[1] - given.sampling_offset
    return Outlook(experiment, view, answer, stroke, known_part, clock)


def in_use(given: ModelFile) -> ModelSpec:
    """Return the model of a file with its sampling offset."""
    return ModelSpec(given.model, dict(given.values), sampling_offset=given.sampling_offset)


def sensitivities_of(spec: ModelSpec, deviations: dict[str, float], view: FitData) -> FloatArray:
    """Return the response to one standard deviation of each value, shape (p, n) [m]."""
    answer = answer_of(spec, view)
    rows = []
    for name, deviation in deviations.items():
        moved = _moved(spec, name, deviation, view)
        if moved is not None and np.all(np.isfinite(moved)):
            rows.append(moved - answer)
    return np.array(rows).reshape(len(rows), answer.size)


def _moved(spec: ModelSpec, name: str, step: float, view: FitData) -> FloatArray | None:
    for way in (step, -step):
        values = {**spec.values, name: spec.values[name] + way}
        try:
            return answer_of(
                ModelSpec(spec.model, values, sampling_offset=spec.sampling_offset), view
            )
        except PiezoError:
            continue
    return None


def within(outlooks: Sequence[Outlook], stroke: float) -> list[Outlook]:
    """Return the experiments with a predicted stroke within a limit [m]."""
    return [each for each in outlooks if each.stroke <= stroke]
