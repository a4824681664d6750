"""Investigation of an actuator that Python reaches: a function, an object, a model or a preset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.operating_limits import operating_limits, rate_of
from piezo_hysteresis.compensation.study import PRESET, open_plant
from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, PlannedExperiment
from piezo_hysteresis.investigation.runner import (
    InvestigationProgress,
    Result,
    Setup,
    run_investigation,
)
from piezo_hysteresis.investigation.session import Rules
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.records import Record, write_bag


class Exchanging(Protocol):
    """An actuator that takes a voltage a tick."""

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; return the displacement before it acts [m]."""


class _Actuator:
    """Runs each experiment on a function of the whole voltage."""

    def __init__(self, measure: Callable[[FloatArray], FloatArray], rate: float) -> None:
        self._measure, self._rate = measure, rate

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        voltage = experiment.voltage(self._rate)
        displacement = np.asarray(self._measure(voltage), np.float64)
        record = Record(
            experiment.name, 1.0 / self._rate, voltage, displacement, info=experiment.info
        )
        write_bag(bag, [record])
        return True

    def apply(self, model: ModelFile) -> str:
        return ''


def investigate(
    model: ModelLike,
    plant: Callable[[FloatArray], FloatArray] | Exchanging | ModelLike,
    out: str | Path = 'investigation',
    *,
    rate: float | None = None,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    max_frequency: float = ExperimentLimits.frequency,
    budget: float = Rules.budget,
    sure: float = Rules.sure,
    noise: float = 0.0,
    seed: int = 0,
    workers: int = 1,
    progress: Callable[[InvestigationProgress], None] = lambda progress: None,
) -> Result:
    """Find the effects that a model lacks by experiments of its own choice on an actuator.

    Parameters
    ----------
    model : str, Path, Model, Identification or Discovery
        The model in use, with values.
    plant : callable, object, model or str
        The actuator: a function that applies a voltage, shape (n,) [V], at the rate and returns
        the displacement [m] of every tick; the actuator then rests at the last voltage; an object
        with ``exchange(voltage)``; a model with values; or ``'preset:NAME'`` of piezo_sim.
    out : str or Path
        Folder of journal, bags and verdict; the same call continues an interrupted investigation.
    rate : float, optional
        Sampling rate [Hz]; that of the data of the model, or 1000.
    low, high, slew : float, optional
        Limits of the voltage [V], [V/s]; those of the data of the model.
    max_frequency : float
        Highest frequency of a drive [Hz].
    budget : float
        Actuator time [s].
    sure : float
        Probability from which an effect counts as confirmed.
    noise : float
        Rms of the measurement noise of a model as plant [m].
    seed : int
        Seed of all random choices.
    workers : int
        Threads; the result does not depend on it.
    progress : callable
        Called with an `InvestigationProgress`.

    Returns
    -------
    Result
        Its ``words`` are the summary; the report is ``found/report.html`` in the folder.

    Raises
    ------
    PiezoError
        If the limits allow no investigation, or the plant fails.
    """
    used = with_values(model)
    sampled = rate_of(used, rate)
    known = operating_limits(used, low=low, high=high, slew=slew)
    known.require_known()
    bounds = known.limits
    limits = ExperimentLimits(bounds.low, bounds.high, bounds.slew, max_frequency, rest=known.rest)
    setup = Setup(used, limits, Rules(budget=budget, sure=sure, seed=seed), sampled)

    def conducted(measure: Callable[[FloatArray], FloatArray]) -> Result:
        actuator = _Actuator(measure, sampled)
        return run_investigation(Path(out), setup, actuator, progress, workers=workers)

    if hasattr(plant, 'exchange'):
        return conducted(lambda voltage: _exchanged(plant, voltage))
    if callable(plant):
        return conducted(plant)
    preset = isinstance(plant, str) and plant.startswith(PRESET)
    given = str(plant).removeprefix(PRESET) if preset else with_values(plant)
    with open_plant(given, 1.0 / sampled, seed, noise=noise, settings=()) as (driven, _):
        return conducted(lambda voltage: _exchanged(driven, voltage))


def _exchanged(plant: Exchanging, voltage: FloatArray) -> FloatArray:
    return np.array([plant.exchange(float(each)) for each in voltage])
