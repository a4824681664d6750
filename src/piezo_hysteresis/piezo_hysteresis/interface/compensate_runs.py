"""Compensation study in one call, with the same runs as the verb ``compensate``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.modal_model import ModalModel
from piezo_hysteresis.axes.modal_search import ModalIdentification
from piezo_hysteresis.common.results import Reportable
from piezo_hysteresis.common.wording import choices, counted
from piezo_hysteresis.compensation.controllers import ATTENUATIONS, Controllers, Feedback
from piezo_hysteresis.compensation.feedback.feedback_link import PidGains
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings, Method
from piezo_hysteresis.compensation.link import INVERSES
from piezo_hysteresis.compensation.operating_limits import rate_of
from piezo_hysteresis.compensation.study import PRESET, Run, Study, remarks, track
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.interface.axes_runs import AxesCompensation, compensate_axes
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.load import reference_record
from piezo_hysteresis.waveforms import Waveform
from piezo_hysteresis.waveforms.waveform import Sampled


@dataclass(frozen=True, repr=False)
class Compensation(Reportable):
    """Runs of a reference on a plant, from no compensation to all requested controllers.

    Attributes
    ----------
    runs : tuple of Run
        Name, signals (``result``) and errors (``metrics``) of each run; the first is without
        compensation.
    reference : str
        The reference.
    study : Study
        All settings.
    seconds : float
        Computing time [s].
    """

    _INSTEAD: ClassVar = {
        'voltage': 'u',
        'best.result.displacement': 'y displacement',
        'best.result.time': 'time t',
        'best.result.error': 'error',
        'best.metrics.rms': 'rms rmse',
        'best.metrics': 'metrics',
        'best.result': 'result',
        "runs[1], of name 'feedforward'": 'feedforward',
        'report(path), which writes voltage.csv': 'save',
        'ph.export(model, path)': 'export',
    }

    runs: tuple[Run, ...]
    reference: str
    study: Study = field(repr=False)
    seconds: float

    def __repr__(self) -> str:
        lines = [f'Compensation of {self.reference} with {self.study.model.model.name}']
        lines += [
            f'  {run.name}: tracking error {1e6 * run.metrics.rms:.3g} µm rms, at most '
            f'{1e6 * run.metrics.largest:.3g} µm'
            for run in self.runs
        ]
        return '\n'.join((*lines, *(f'  {each}' for each in self.warnings)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was limited, clamped or cannot work, in sentences, as the command prints them."""
        return remarks(self.study, self.runs)

    @property
    def limited(self) -> dict[str, dict[str, int]]:
        """How many samples of each run the limiter changed, by its reason."""
        return {run.name: dict(run.result.counters['limiter']) for run in self.runs}

    @property
    def best(self) -> Run:
        """The run with the smallest rms tracking error."""
        return min(self.runs, key=lambda run: run.metrics.rms)

    @property
    def voltage(self) -> FloatArray:
        """Voltage of the best run [V], shape (n,)."""
        return self.best.result.voltage

    def columns(self) -> dict[str, list[Any]]:
        """Return the tracking errors by column, one row per run; lengths are in metres."""
        metrics = [run.metrics for run in self.runs]
        return {
            'run': [run.name for run in self.runs],
            'rms_m': [each.rms for each in metrics],
            'rms_without_mean_m': [each.rms_without_mean for each in metrics],
            'largest_m': [each.largest for each in metrics],
            'mean_m': [each.mean for each in metrics],
        }


@overload
def compensate(
    model: ModalModel | ModalIdentification,
    reference: ArrayLike,
    plant: Any = None,
    *,
    noise: float = 0.0,
    seed: int = 0,
) -> AxesCompensation: ...


@overload
def compensate(
    model: ModelLike,
    reference: str | Path | Waveform | ArrayLike,
    plant: ModelLike | None = None,
    *,
    dt: float | None = None,
    rate: float | None = None,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    law: str = 'auto',
    attenuation: str | AttenuationSettings = 'afc',
    pid: Sequence[float] | None = None,
    noise: float = 0.0,
    seed: int = 0,
    from_seconds: float | None = None,
    reading: ReadOptions | None = None,
) -> Compensation: ...


def compensate(
    model: ModelLike | ModalModel | ModalIdentification,
    reference: Any,
    plant: Any = None,
    *,
    dt: float | None = None,
    rate: float | None = None,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    law: str = 'auto',
    attenuation: str | AttenuationSettings = 'afc',
    pid: Sequence[float] | None = None,
    noise: float = 0.0,
    seed: int = 0,
    from_seconds: float | None = None,
    reading: ReadOptions | None = None,
) -> Compensation | AxesCompensation:
    """Track a reference on a plant with the inverse of a model, and with feedback around it.

    Parameters
    ----------
    model : str, Path, ModelFile, Identification or Discovery
        A model with values; its inverse is the feedforward. A model of several axes takes one
        period of references of shape (n, axes) at its interval, a plant, `noise` and `seed`.
    reference : str, Path, Waveform or array_like, shape (n,)
        Desired displacement [m]: in words such as
        ``'sine:frequency=23,amplitude=80e-6,duration=4'``, an array at `dt`, or a file of columns
        ``time_s, reference_um``.
    plant : str, Path, ModelFile, Identification or Discovery, optional
        The actuator: a model with values, or ``'preset:NAME'`` for a simulated actuator of
        piezo_sim. By default `model` itself: the error is then that of the inverse alone.
    dt : float, optional
        Sampling interval of an array, and of the loop [s].
    rate : float, optional
        Sampling rate of the loop [Hz]; that of an array or a file, that of the data of the model,
        or 1000.
    low, high : float, optional
        Range of the voltage [V]; that of the preset, or of the records of the model.
    slew : float, optional
        Slew rate limit of the voltage [V/s]; that of the preset, or of the records of the model.
    law : str
        Kind of inverse, one of `piezo_hysteresis.compensation.link.INVERSES`.
    attenuation : str or AttenuationSettings
        Method that attenuates the harmonics of the error, ``'none'`` for no attenuation.
    pid : sequence of float, shape (3,), optional
        Gains of a PID controller: [V/m], [V/(m s)], [V s/m]. No feedback by default.
    noise : float
        Rms of the measurement noise of a model as plant [m].
    seed : int
        Seed of the noise.
    from_seconds : float, optional
        Start of the evaluated part [s]; half of the reference by default.
    reading : ReadOptions, optional
        What a reference file does not state itself, such as its interval or unit.

    Returns
    -------
    Compensation, or AxesCompensation of several axes
        Signals and errors of every run.

    Raises
    ------
    CompensationError
        If the reference is unknown or out of range, or a controller cannot be designed.
    ModelError
        If the model is unknown or has no values.
    """
    started = time.perf_counter()
    if isinstance(model, (ModalModel, ModalIdentification)):
        return compensate_axes(model, reference, plant, noise, seed)
    inverted = with_values(model)
    sampled = 1.0 / dt if rate is None and dt is not None else rate
    reference, sampled = reference_of(reference, sampled, inverted, reading)
    _require_one_of('law', law, INVERSES)
    controllers = Controllers(
        1.0 / rate_of(inverted, sampled), model=inverted, law=law,
        attenuation=_attenuation(attenuation), feedback=_feedback(pid),
    )  # fmt: skip
    study, runs = track(
        controllers, _plant(plant, inverted), reference, low=low, high=high, slew=slew,
        together=True, noise=noise, seed=seed, from_seconds=from_seconds,
    )  # fmt: skip
    shown = reference if isinstance(reference, str) else f'a {type(reference).__name__} waveform'
    if isinstance(reference, Sampled):
        shown = f'{counted(reference.values.size, "sample")} at {1.0 / reference.dt:g} Hz'
    return Compensation(tuple(runs), shown, study, time.perf_counter() - started)


def reference_of(
    given: object,
    rate: float | None,
    model: ModelFile,
    reading: ReadOptions | None = None,
    salvage: bool = False,
) -> tuple[str | Waveform, float | None]:
    """Return a reference as text or waveform, and the rate of the loop [Hz] that it asks for."""
    if isinstance(given, Path) or (isinstance(given, str) and ':' not in given and '.' in given):
        given = reference_record(Path(given), reading, salvage)
    elif reading is not None and reading != ReadOptions():
        raise CompensationError(
            'what is stated about a file (interval, sign, unit, ...) needs a reference that is one'
        )
    if isinstance(given, (np.ndarray, list, tuple)):
        step = 1.0 / rate_of(model, rate)
        return Sampled(np.asarray(given, np.float64), step), 1.0 / step
    if hasattr(given, 'displacement') and hasattr(given, 'dt'):  # a record
        column = getattr(given, 'reference', None)
        values = given.displacement if column is None else column
        return Sampled(values, given.dt), rate or 1.0 / given.dt
    return cast('str | Waveform', given), rate


def _plant(given: ModelLike | None, inverted: ModelFile) -> ModelFile | str:
    """Return the model used as the plant, or the name of a preset."""
    if given is None:
        return inverted
    if isinstance(given, str) and given.startswith(PRESET):
        return given.removeprefix(PRESET)
    return with_values(given)


def _attenuation(given: str | AttenuationSettings) -> AttenuationSettings | None:
    if isinstance(given, AttenuationSettings):
        return given
    _require_one_of('attenuation', given, ATTENUATIONS)
    if given == 'none':
        return None
    return AttenuationSettings(method=cast(Method, given))


def _feedback(pid: Sequence[float] | None) -> Feedback | None:
    if pid is None:
        return None
    if not (isinstance(pid, Sequence) and len(pid) == 3):
        raise CompensationError(f'pid is three gains, [V/m], [V/(m s)] and [V s/m], got {pid!r}')
    return Feedback('pid', PidGains(*pid))


def _require_one_of(what: str, given: object, known: tuple[str, ...]) -> None:
    if given not in known:
        raise CompensationError(f'{what} {given!r} is unknown{choices(given, known)}')
