"""References of several axes on a plant: each axis alone, decoupled, learnt by the period."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.inverse import change_for, inverse, lines_of
from piezo_hysteresis.axes.modal_derivatives import ModalDerivatives
from piezo_hysteresis.axes.modal_model import ModalModel, drive_of
from piezo_hysteresis.errors import CompensationError, ModelError
from piezo_hysteresis.numerics.linalg import failing_as

# Share of the measured error that a period corrects, and the share of the error that it must leave
# for another one.
_STEP, _ENOUGH = 0.7, 0.98


@dataclass(frozen=True, eq=False)
class AxesRun:
    """One period of references on a plant."""

    name: str  # what was done
    voltage: FloatArray  # voltages [V], shape (n, inputs)
    displacement: FloatArray  # what the plant does, without its mean [m], shape (n, outputs)
    error: FloatArray  # reference without its mean minus `displacement` [m], shape (n, outputs)

    @property
    def rms(self) -> FloatArray:
        """Error of each output, shape (outputs,) [m rms]."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))


def tracked(
    model: ModalModel,
    plant: ModalModel,
    reference: FloatArray,  # [m] (n, outputs)
    *,
    highest: float | None = None,  # [Hz]
    rounds: int = 20,
    noise: float = 0.0,  # [m rms]
    seed: int = 0,
) -> list[AxesRun]:
    """Return the runs of a periodic reference on a plant, from no compensation to learning.

    ``each axis alone`` divides each reference by the static gain of its own axis; ``feedforward``
    inverts the model of all axes; ``with attenuation`` corrects the measured error of each period
    by the matrix of gains of the model, line by line, as long as the error falls.
    """
    ours, theirs = (
        (each.layout.inputs, each.layout.outputs, float(f'{each.dt:.6g}'))
        for each in (model, plant)
    )
    if ours != theirs:
        raise CompensationError(
            'the plant must have the axes and the interval of the model: it has '
            f'{theirs[0]} voltages, {theirs[1]} displacements, {theirs[2]:g} s, the model '
            f'{ours[0]}, {ours[1]}, {ours[2]:g} s'
        )
    target = np.asarray(reference, float) - np.mean(reference, axis=0)
    period = AxesRecord('period', model.dt, inverse(model, reference, highest).voltage, target, 1)
    drive, rng = drive_of(period, model.layout), np.random.default_rng(seed)
    with failing_as(ModelError('the model has no inverse for this reference')):
        response = ModalDerivatives(model, drive, model.signals(drive)).response()

    def run(name: str, voltage: FloatArray) -> AxesRun:
        y = plant.simulate(replace(period, voltage=voltage))
        return AxesRun(name, voltage, y, target - y)

    runs = [run('feedforward', period.voltage)]
    if model.layout.inputs == model.layout.outputs:
        gains = response[0].diagonal().real
        runs.insert(0, run('each axis alone', target / gains))
    best, lines = replace(runs[-1], name='with attenuation'), lines_of(model, len(target), highest)
    for _ in range(rounds):
        measured = best.error + noise * rng.standard_normal(target.shape)
        step = change_for(response, measured, lines)
        after, left = run(best.name, best.voltage + _STEP * step), best.rms.max()
        best = after if after.rms.max() < left else best
        if after.rms.max() > _ENOUGH * left:
            break
    return [*runs, best]
