"""References of several axes on a plant: each axis alone, decoupled, learnt by the period."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import BoolArray, ComplexArray, FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.modal_fit import ModalDerivatives
from piezo_hysteresis.axes.modal_model import AxesDrive, ModalLayout, ModalModel, drive_of
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import CompensationError, ModelError
from piezo_hysteresis.numerics.linalg import failing_as

_TURNS = 30
_STEP = 0.8
_ENOUGH = 0.99  # a turn that leaves more than this part of the error is the last
WEAK = 1e-3  # smallest singular value of a line that is inverted, of its largest


@dataclass(frozen=True, eq=False)
class AxesInverse:
    """Voltages for a periodic reference, and what the model says of them.

    Attributes
    ----------
    voltage : ndarray, shape (n, inputs)
        One period [V].
    displacement : ndarray, shape (n, outputs)
        Displacement of the model without its mean [m].
    error : ndarray, shape (outputs,)
        Its rms distance from the reference without its mean [m].
    """

    voltage: FloatArray
    displacement: FloatArray
    error: FloatArray


def inverse(model: ModalModel, reference: FloatArray, highest: float | None = None) -> AxesInverse:
    """Invert a model for one period of references, by turns of its own linear response."""
    # reference [m] (n, outputs); highest [Hz]
    target = np.asarray(reference, float)
    layout = model.layout
    if target.ndim != 2 or target.shape[1] != layout.outputs or not np.isfinite(target).all():
        raise ModelError(
            f'the reference must be finite numbers of shape (samples, {layout.outputs}), got '
            f'{target.shape}'
        )
    target = target - target.mean(0)
    lines = lines_of(model, target.shape[0], highest)
    with failing_as(ModelError('the model has no inverse for this reference')):
        return _turns(model, target, lines)


def lines_of(model: ModalModel, samples: int, highest: float | None = None) -> BoolArray:
    """Return which lines above 0 Hz of a period are inverted, shape (samples // 2,)."""
    frequency = np.fft.rfftfreq(samples, model.dt)[1:]
    top = float(np.exp(model.parameters['log_omega'].max()) / (2.0 * np.pi))
    return np.asarray(frequency <= (top if highest is None else highest))


def _turns(model: ModalModel, target: FloatArray, lines: BoolArray) -> AxesInverse:
    """Return the inverse after as many turns as lower the error."""
    voltage = np.zeros((target.shape[0], model.layout.inputs))
    best: AxesInverse | None = None
    for _ in range(_TURNS):
        record = AxesRecord('reference', model.dt, voltage, target, periods=1)
        drive = AxesDrive(record, model.layout)
        signals = model.signals(drive)
        y = model.displacement(drive, signals)
        error = np.sqrt(np.mean((target - y) ** 2, 0))
        found = AxesInverse(voltage, y, error)
        if best is not None and error.max() > _ENOUGH * best.error.max():
            return best if error.max() > best.error.max() else found
        best = found
        response = ModalDerivatives(model, drive, signals).response()
        voltage = voltage + _STEP * change_for(response, target - y, lines)
    assert best is not None
    return best


def change_for(response: ComplexArray, error: FloatArray, lines: BoolArray) -> FloatArray:
    """Return the voltages that a response needs for an error, in the given lines."""
    # response [m/V] (lines, outputs, inputs); error [m] (n, outputs); lines (lines,) -> [V] (n,
    # inputs)
    spectrum = np.fft.rfft(error, axis=0)
    change = np.zeros((spectrum.shape[0], response.shape[2]), complex)
    solved = np.linalg.pinv(response[lines], WEAK) @ spectrum[1:][lines][:, :, None]
    change[1:][lines] = solved[:, :, 0]
    return np.asarray(np.fft.irfft(change, error.shape[0], axis=0))


# Share of the measured error that a period corrects, and the share of the error that it must leave
# for another one.
_AXES_TRACKING_STEP, _AXES_TRACKING_ENOUGH = 0.7, 0.98
_LINE = 1e-3  # part of the largest line of a reference that another line of it has at least


class PeriodicPlant(Protocol):
    """What answers a period of voltages with one of displacements, in steady state."""

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""

    @property
    def layout(self) -> ModalLayout:
        """Numbers of voltages and displacements."""

    def simulate(self, record: AxesRecord) -> FloatArray:
        """Return the displacements of a record of one period, shape (n, outputs) [m]."""


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

    @property
    def cross_talk(self) -> FloatArray:
        """Motion of axis j in the lines of the reference of axis i alone, over that reference.

        Shape (outputs, outputs); not a number on the diagonal, and where no line is of i alone.
        """
        moved = np.abs(np.fft.rfft(self.displacement, axis=0))
        asked = np.abs(np.fft.rfft(self.displacement + self.error, axis=0))
        count = asked.shape[1]
        found = np.full((count, count), np.nan)
        largest = asked.max(0)
        held = (asked > _LINE * largest) & (largest > _LINE * largest.max())
        for j in range(count):
            for i in range(count):
                lines = held[:, i] & ~held[:, j]
                if i != j and lines.any():
                    found[j, i] = np.linalg.norm(moved[lines, j]) / np.linalg.norm(asked[lines, i])
        return found


def tracked(
    model: ModalModel,
    plant: PeriodicPlant,
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
            f'{counted(theirs[0], "voltage")}, {counted(theirs[1], "displacement")}, '
            f'{theirs[2]:g} s, the model {ours[0]}, {ours[1]}, {ours[2]:g} s'
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
        after, left = run(best.name, best.voltage + _AXES_TRACKING_STEP * step), best.rms.max()
        best = after if after.rms.max() < left else best
        if after.rms.max() > _AXES_TRACKING_ENOUGH * left:
            break
    return [*runs, best]
