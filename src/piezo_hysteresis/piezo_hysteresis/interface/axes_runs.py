"""Actuators of several axes as plants: models, and simulated ones in a separate process."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.axes_tracking import PeriodicPlant
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.compensation.model_plant import ProcessPlant, command_of
from piezo_hysteresis.compensation.study import PRESET
from piezo_hysteresis.errors import CompensationError

_COUNT = struct.Struct('<q')
_SETTLING = 0.5  # of periods before a measured one [s]


class SteadyAxes(ProcessPlant):
    """Simulated actuators of several axes in a separate program, period by period."""

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return 1.0 / float(self.about['rate_hz'])

    @property
    def layout(self) -> ModalLayout:
        """Numbers of voltages and displacements."""
        axes = int(self.about.get('axes', 1))
        return ModalLayout(axes, axes, 0)

    def run(self, voltage: FloatArray) -> FloatArray:
        """Return the displacements for voltages of all axes, shape (n, axes) both."""
        given = np.ascontiguousarray(voltage, '<f8')
        answer = self.ask(_COUNT.pack(len(given)) + given.tobytes(), given.nbytes)
        return np.frombuffer(answer, '<f8').reshape(given.shape)

    def simulate(self, record: AxesRecord) -> FloatArray:
        """Return a period of displacements without their mean, after some that settle it."""
        low, high = float(record.voltage.min()), float(record.voltage.max())
        if low < self.about['low_v'] or high > self.about['high_v']:
            raise CompensationError(
                f'the references need {low:.4g} to {high:.4g} V, but {self.about["preset"]} takes '
                f'{self.about["low_v"]:g} to {self.about["high_v"]:g} V: move less or slower'
            )
        settling = max(2, math.ceil(_SETTLING / (record.dt * len(record))))
        for _ in range(settling):
            self.run(record.voltage)
        moved = self.run(record.voltage)
        return np.asarray(moved - moved.mean(0))


@contextmanager
def axes_plant(
    given: str | Path | ModalModel,
    dt: float,  # [s]
    *,
    noise: float = 0.0,  # [m rms]
    seed: int = 0,
    settings: Sequence[str] = (),
) -> Iterator[PeriodicPlant]:
    """Open a plant of several axes: a model, its file, or ``preset:NAME``."""
    if isinstance(given, str) and given.startswith(PRESET):
        if noise:
            raise CompensationError(
                'a simulated plant has its own noise; set it by --plant-set '
                'axis_1.sensor.noise_rms=... for each axis'
            )
        name = given.removeprefix(PRESET)
        with closing(SteadyAxes(command_of(name, 1.0 / dt, seed, settings))) as plant:
            yield plant
        return
    if settings:
        raise CompensationError('--plant-set is for a simulated plant, preset:NAME')
    yield given if isinstance(given, ModalModel) else ModalModel.load(given)
