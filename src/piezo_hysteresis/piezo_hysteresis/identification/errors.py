"""Errors of a model over whole records, as users quote them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.objective import shifted
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record


@dataclass(frozen=True)
class RecordErrors:
    """Errors of a model over one record, after its warm-up.

    Attributes
    ----------
    record : str
        Name.
    one_step_rms : float
        Rms of the one-step prediction error [m], see `one_step`.
    free_run_rms : float
        Rms of the free-run error [m], offset included.
    nrmse_percent : float
        100 times the free-run error over the standard deviation of the displacement.
    """

    record: str
    one_step_rms: float
    free_run_rms: float
    nrmse_percent: float


def free_run(
    model: Model,
    values: Mapping[str, float],
    record: Record,
    sampling_offset: float = 0.0,
    *,
    steady: bool = False,
    checked: bool = True,
) -> FloatArray:
    """Simulate a record from rest; return the displacement [m], shape (n,).

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters.
    record : Record
        Whose voltage drives it.
    sampling_offset : float
        By how much later than our convention the displacement was sampled [s].
    steady : bool
        The record is whole periods in steady state: run through it once before it counts.
    checked : bool
        False simulates also what the model refuses, such as unstable recursions.
    """
    voltage = np.tile(record.voltage, 2) if steady else record.voltage
    packed = model.pack(values, checked=checked)
    with np.errstate(over='ignore', invalid='ignore'):
        y = model.respond(
            voltage,
            packed,
            record.dt,
            state=model.initial_state(record.dt, record.start),
            frequency=record.info.frequency,
        )
    if sampling_offset:
        y = shifted(y, sampling_offset / record.dt)
    return y[-len(record) :]


def one_step(model: Model, values: Mapping[str, float], error: FloatArray) -> FloatArray:
    """Return the one-step prediction error that belongs to a free-run error, shape (n,).

    A chain with the papers' autoregression predicts from the measured past, as 000 (3) says. Every
    other chain predicts its own increment on top of the last measurement.
    """
    c1 = c2 = 0.0
    if any(block.name == 'autoregressive' for block in model.blocks):
        c1, c2 = values['c1'], values['c2']
    past = np.concatenate([np.full(3, error[0]), error])
    n = error.size
    with np.errstate(over='ignore', invalid='ignore'):
        return np.asarray(error - past[2 : n + 2] - c1 * past[1 : n + 1] - c2 * past[:n])


def errors_of(
    model: Model,
    values: Mapping[str, float],
    records: Sequence[Record],
    sampling_offset: float = 0.0,
    *,
    steady: bool = False,
    checked: bool = True,
) -> tuple[RecordErrors, ...]:
    """Return the errors of a model over records, each after its warm-up; see `free_run`."""
    rows = []
    for record in records:
        simulated = free_run(
            model, values, record, sampling_offset, steady=steady, checked=checked
        )
        error = record.displacement - simulated
        cut = slice(record.warm_up_samples, None)
        free = _rms(error[cut])
        spread = float(np.std(record.displacement[cut]))
        rows.append(
            RecordErrors(
                record=record.name,
                one_step_rms=_rms(one_step(model, values, error)[cut]),
                free_run_rms=free,
                nrmse_percent=100 * free / spread if spread > 0 else float('nan'),
            )
        )
    return tuple(rows)


def _rms(x: FloatArray) -> float:
    with np.errstate(over='ignore', invalid='ignore'):
        return sqrt(float(np.mean(x * x)))
