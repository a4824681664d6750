"""What `identify`, `discover` and `compensate` do with several axes, and plants of them.

A plant is a model, or simulated actuators in a separate process.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.axes_tracking import AxesRun, PeriodicPlant, tracked
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.axes.modal_search import ModalIdentification
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.compensation.coupled.axes_chain import axes_chain, axes_loop, repeated
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.limiter import require_limits
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.offline_loop import ProcessPlant, command_of
from piezo_hysteresis.compensation.study import PRESET
from piezo_hysteresis.errors import CompensationError, IdentificationError
from piezo_hysteresis.export.coupled_library import coupled_files
from piezo_hysteresis.export.native import known_target
from piezo_hysteresis.interface.model_functions import IDENTIFIER
from piezo_hysteresis.models.modelfile import is_modal
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.waveforms.waveform import Samples

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

    def reset(self) -> None:
        """Return all axes to rest and restart their noise."""
        self.ask(_COUNT.pack(0), 0)

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


def tick_by_tick(
    model: ModalModel,
    plant: PeriodicPlant,
    references: Sequence[Samples],  # one period of each axis [m]
    limits: Limits,  # of each axis
    settings: MatrixSettings | None,
    periods: int,
) -> list[AxesRun]:
    """Return the last period of references that the law of the nodes follows, from rest.

    The plant must be a simulated one, which takes single ticks.
    """
    if not isinstance(plant, SteadyAxes):
        raise CompensationError('--periods follows tick by tick, on a simulated plant preset:NAME')
    each = [limits] * len(references)
    whole = [repeated(samples, periods) for samples in references]
    n, found = references[0].value.size, list[AxesRun]()
    for name, own in (('feedforward, by ticks', None), ('attenuation, by ticks', settings)):
        if own is None and found:
            break
        plant.reset()
        chain = axes_chain(model, each, own, 1.0 / model.dt)
        run = axes_loop(whole, chain, plant, each)
        error, moved = -run.error[-n:], run.displacement[-n:]
        found.append(AxesRun(name, run.voltage[-n:], moved - moved.mean(0), error - error.mean(0)))
    return found


MODES = 'modes'
_OURS = {'dt', 'fs', 'workers', 'progress', 'modes', 'effects'}


def is_several(data: object, model: object) -> bool:
    """Return whether a call is of several axes, by its model or by its records."""
    given = data if isinstance(data, (list, tuple)) else [data]
    of_axes = isinstance(model, (str, Path)) and (str(model) == MODES or is_modal(model))
    return of_axes or any(isinstance(each, AxesRecord) for each in given)


def several_records(
    data: Any, options: Mapping[str, Any], defaults: Mapping[str, Any]
) -> list[AxesRecord]:
    """Return the records of a call; refuse options that are of one axis."""
    strange = [
        name
        for name, value in options.items()
        if name not in _OURS and not _same(value, defaults.get(name))
    ]
    if strange:
        raise IdentificationError(f'{strange[0]} is of one axis; leave it out')
    return load_axes(data, dt=options.get('dt'), fs=options.get('fs'))


def _same(value: object, default: object) -> bool:
    return value is default or (isinstance(value, (str, int, tuple)) and value == default)


@dataclass(frozen=True, repr=False, eq=False)
class AxesCompensation(Guided):
    """Runs of references of several axes on a plant, from no compensation to attenuation.

    Attributes
    ----------
    runs : tuple of AxesRun
        Name, ``voltage`` [V], ``displacement`` and ``error`` [m] of one period, all of shape (n,
        axes), ``rms`` [m] and ``cross_talk`` of each run.
    """

    runs: tuple[AxesRun, ...]

    @property
    def best(self) -> AxesRun:
        """The run with the smallest error on its worst axis."""
        return min(self.runs, key=lambda run: float(run.rms.max()))

    @property
    def voltage(self) -> FloatArray:
        """Voltages of the best run [V], shape (n, axes)."""
        return self.best.voltage

    def __repr__(self) -> str:
        lines = ['Compensation of several axes']
        for run in self.runs:
            errors = ', '.join(f'{1e6 * rms:.4g}' for rms in run.rms)
            lines.append(f'  {run.name}: error {errors} µm rms')
        return '\n'.join(lines)


def compensate_axes(
    model: ModalModel | ModalIdentification,
    reference: ArrayLike,
    plant: str | Path | ModalModel | ModalIdentification | None,
    noise: float,
    seed: int,
) -> AxesCompensation:
    """Track periodic references of all axes, (n, axes) [m], on a plant."""
    inverted = model.model if isinstance(model, ModalIdentification) else model
    given = plant.model if isinstance(plant, ModalIdentification) else plant
    if isinstance(reference, (str, Path)):
        raise CompensationError(
            'references of several axes are an array of shape (samples, '
            f'{inverted.layout.outputs}), in m'
        )
    with axes_plant(given or inverted, inverted.dt, noise=noise, seed=seed) as opened:
        runs = tracked(inverted, opened, np.asarray(reference, float), noise=noise, seed=seed)
    return AxesCompensation(tuple(runs))


def write_coupled_library(
    model: str | Path,
    path: str | Path,
    *,
    limits: Limits,  # of each axis
    rate: float | None,  # [Hz]
    settings: MatrixSettings | None,  # None for feedforward alone
    name: str,
    target: str,
) -> int:
    """Write the library of a model of several axes; return the size of the archive."""
    known_target(target)
    if not IDENTIFIER.fullmatch(name):
        raise CompensationError(f'{name!r} is no name in C; give letters and digits')
    found = ModalModel.load(model)
    if rate is not None and abs(found.dt * rate - 1.0) > 1e-6:
        raise CompensationError(
            f'the model is of {1.0 / found.dt:g} Hz, which its library keeps; leave out --rate'
        )
    require_limits(limits)
    text = Path(model).read_text(encoding='utf-8')
    files = coupled_files(name, text, found, limits, settings, target)
    write_folder(path, files, 'export')
    return len(files[f'lib{name}.a'])
