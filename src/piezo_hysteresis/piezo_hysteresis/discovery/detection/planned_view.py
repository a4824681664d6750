"""A planned experiment as a view for the fit functions."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.identification.initial_conditions.record_start import STEP
from piezo_hysteresis.identification.targets import Target

# Ticks of rest before a record.
_EDGE = 4


def view_of(experiment: PlannedExperiment, rate: float, noise: float) -> Target:
    """Return an experiment as a view for the fit functions, with zero measured displacement."""
    driven = experiment.voltage(rate)
    voltage = np.concatenate([np.full(_EDGE, driven[0]), driven])
    first = _EDGE + round(experiment.prelude * rate)
    return Target(
        name=experiment.name,
        voltage=voltage,
        measured=np.zeros(voltage.size - first),
        first=first,
        stride=1,
        dt=1.0 / rate,
        frequency=experiment.frequency,
        repeats=1,
        noise=noise,
        period=0,
        start=-_EDGE / rate,
        origin=_EDGE,
        begins=STEP,
    )
