"""Errors of a model over whole records: one-step, free-run and normalised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import InterSample, Slot
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.identification.fit_data import FitData, targets_of
from piezo_hysteresis.identification.initial_conditions.revision import (
    RecordAssumptions,
    estimate_nuisances,
)
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record


@dataclass(frozen=True)
class RecordErrors(Guided):
    """Errors of a model over one record, after its warm-up.

    Attributes
    ----------
    record : str
        Name.
    one_step_rms : float
        Rms of the one-step prediction error [m], see `one_step`.
    free_run_rms : float
        Rms of the free-run error [m], offset included, over all samples, the excluded ones too.
    nrmse_percent : float
        100 times the free-run error over the standard deviation of the displacement.
    start : str
        Initial condition of the record.
    own_zero : bool
        Whether the record has its own zero of the displacement.
    noise_rms : float
        Noise of one sample [m]; NaN if it cannot be estimated.
    lost : int
        Number of samples excluded from the fit: spikes and drop-outs.
    """

    _INSTEAD: ClassVar = {
        'record': 'name',
        'free_run_rms': 'rmse rms error',
        'nrmse_percent': 'nrmse',
        'noise_rms': 'noise',
    }

    record: str
    one_step_rms: float
    free_run_rms: float
    nrmse_percent: float
    start: str = 'step'
    own_zero: bool = False
    noise_rms: float = float('nan')
    lost: int = 0


def views_of(
    model: Model,
    values: Mapping[str, float],
    records: Sequence[Record],
    sampling_offset: float = 0.0,
    choices: RecordAssumptions | None = None,
    *,
    checked: bool = True,
    workers: int = 1,
) -> tuple[FitData, ...]:
    """Return whole records with initial conditions and zeros estimated by the model.

    Parameters
    ----------
    model, values, sampling_offset
        The model, its parameters, and the clock of the recordings [s].
    records : sequence of Record
        Measured records.
    choices : RecordAssumptions, optional
        Given initial conditions and zeros.
    checked : bool
        False accepts models that cannot be simulated.
    workers : int
        Threads over the records.
    """
    chosen, late = choices or RecordAssumptions(), sampling_offset
    targets = targets_of(
        records, folded=False, start=chosen.start, zero=chosen.zero, workers=workers
    )
    if not checked:
        return tuple(targets)
    return tuple(
        estimate_nuisances(
            model, values, late, targets, records, chosen, alone=True, workers=workers
        )
    )


def one_step(model: Model, values: Mapping[str, float], error: FloatArray) -> FloatArray:
    """Return the one-step prediction error for a given free-run error, shape (n,).

    A chain with the autoregression of the papers predicts from past measurements by Fujii 2018
    (3). Every other chain adds its increment to the last measurement.
    """
    factors = _of_past(model, values) or [1.0]
    past = np.concatenate([np.full(len(factors), error[0]), error])
    left = error.copy()
    with np.errstate(over='ignore', invalid='ignore'):
        for lag, factor in enumerate(factors, start=1):
            left -= factor * past[len(factors) - lag :][: error.size]
    return left


def _of_past(model: Model, values: Mapping[str, float]) -> list[float]:
    """Return the factors of the last outputs of a recursion: its free response to each alone."""
    for block in model.blocks:
        if block.slot is Slot.STRUCTURE and block.between is InterSample.TICK:
            p = np.array([values[q.name] for q in block.parameters])
            each = np.eye(block.initial_state(1.0).size)
            return [float(block.respond(np.zeros(1), p, 1.0, state=last)[0]) for last in each]
    return []


def errors_in(model: Model, values: Mapping[str, float], found: Prediction) -> RecordErrors:
    """Return the errors of a prediction of a whole record."""
    view, error = found.target, found.error
    free, spread = _rms(error), float(np.std(view.kept(view.measured)))
    return RecordErrors(
        record=view.name,
        one_step_rms=_rms(one_step(model, values, error)),
        free_run_rms=free,
        nrmse_percent=100 * free / spread if spread > 0 else float('nan'),
        start=str(view.begins),
        own_zero=view.own_zero,
        noise_rms=view.noise,
        lost=view.lost,
    )


def _rms(x: FloatArray) -> float:
    with np.errstate(over='ignore', invalid='ignore'):
        return sqrt(float(np.mean(x * x)))
