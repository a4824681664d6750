"""A study of compensation in one call: the same runs as those of the verb ``compensate``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from numbers import Real
from typing import Any, cast

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.cli.compensate_links import ATTENUATIONS, REPETITIVE, Feedback, Repetition
from piezo_hysteresis.cli.compensate_study import (
    Run,
    Study,
    open_plant,
    parse_reference,
    run_study,
)
from piezo_hysteresis.common.results import Reportable
from piezo_hysteresis.common.wording import near
from piezo_hysteresis.compensation.feedback.feedback_settings import PidGains
from piezo_hysteresis.compensation.harmonics.attenuation_settings import (
    AttenuationSettings,
    Method,
)
from piezo_hysteresis.compensation.link import INVERSES, Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.waveforms import Waveform

_PRESET = 'preset:'


@dataclass(frozen=True, repr=False)
class Compensation(Reportable):
    """Runs of a reference on a plant, from no compensation to all that was asked for.

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
        return '\n'.join(lines)

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


def compensate(
    model: ModelLike,
    reference: str | Waveform,
    plant: ModelLike | None = None,
    *,
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
) -> Compensation:
    """Track a reference on a plant with the inverse of a model, and with feedback around it.

    Parameters
    ----------
    model : str, Path, ModelFile, Identification or Discovery
        A model with values, which is inverted.
    reference : str or Waveform
        Desired displacement [m], such as ``'sine:frequency=23,amplitude=80e-6,duration=4'``.
    plant : str, Path, ModelFile, Identification or Discovery, optional
        The actuator: a model with values, or ``'preset:NAME'`` for a simulated actuator of
        piezo_sim. By default `model` itself: the error is then that of the inverse alone.
    rate : float, optional
        Sampling rate [Hz]; that of the data of the model, or 1000.
    low, high : float, optional
        Range of the voltage [V]; that of the preset, or -1.2 and 1.2.
    slew : float, optional
        Largest change of the voltage [V/s]; that of the preset, or 1000.
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
        Start of the part that is judged [s]; half of the reference by default.

    Returns
    -------
    Compensation
        Signals and errors of every run.

    Raises
    ------
    CompensationError
        If the reference is out of reach or unknown, or a controller cannot be built.
    ModelError
        If there is no such model, or its values are not known.
    """
    started = time.perf_counter()
    inverted = with_values(model)
    given = rate if rate is not None else inverted.provenance.rate or 1000.0
    if not (isinstance(given, (int, float)) and isfinite(given) and given > 0):
        raise CompensationError(f'the rate must be a positive number [Hz], got {given!r}')
    for name, value in {'noise': noise, 'seed': seed, 'from_seconds': from_seconds or 0.0}.items():
        if not (isinstance(value, Real) and isfinite(value) and value >= 0):
            raise CompensationError(f'{name} must be a number of 0 or more, got {value!r}')
    _require_one_of('law', law, INVERSES)
    settings = _attenuation(attenuation)
    driven = _plant(plant, inverted)
    dt = 1.0 / given
    with open_plant(driven, dt, seed, noise=noise, settings=()) as (actuator, about):
        usual = {'offset': about.get('offset_m', 0.0), 'phase': about.get('phase', 0.0)}
        waveform = _waveform(reference, {k: v for k, v in usual.items() if v}, given)
        bounds = (
            about.get(key, default) if value is None else value
            for value, key, default in (
                (low, 'low_v', Limits.low),
                (high, 'high_v', Limits.high),
                (slew, 'slew_v_per_s', Limits.slew),
            )
        )
        study = Study(
            model=inverted,
            slow=None,
            law=law,
            switch=1.0,
            plant=driven,
            waveform=waveform,
            dt=dt,
            limits=Limits(*bounds),
            attenuation=settings,
            gain_model=None,
            feedback=_feedback(pid),
            together=pid is not None and settings is not None,
            noise=noise,
            seed=seed,
            from_seconds=0.5 * waveform.duration if from_seconds is None else from_seconds,
        )
        runs = run_study(study, actuator)
    shown = reference if isinstance(reference, str) else type(reference).__name__.lower()
    return Compensation(tuple(runs), shown, study, time.perf_counter() - started)


def _waveform(reference: str | Waveform, usual: dict[str, float], rate: float) -> Waveform:
    """Return the reference, whose duration is finite and which the rate can sample."""
    if isinstance(reference, str):
        waveform = parse_reference(reference, usual)
    elif hasattr(reference, 'sample') and hasattr(reference, 'duration'):
        waveform = reference
    else:
        raise CompensationError(
            "a reference is text such as 'sine:frequency=23,amplitude=80e-6,duration=4' or a "
            f'Waveform, not of type {type(reference).__name__}'
        )
    frequency = float(getattr(waveform, 'frequency', 0.0))
    if frequency >= 0.5 * rate:
        raise CompensationError(
            f'a reference of {frequency:g} Hz cannot be sampled at {rate:g} Hz; lower the '
            'frequency or raise the rate'
        )
    if not isfinite(waveform.duration) or waveform.duration * rate > 5e7:
        raise CompensationError('the reference is too long; give it a duration')
    return waveform


def _plant(given: ModelLike | None, inverted: ModelFile) -> ModelFile | str:
    """Return the model in the place of the actuator, or the name of a preset."""
    if given is None:
        return inverted
    if isinstance(given, str) and given.startswith(_PRESET):
        return given.removeprefix(_PRESET)
    return with_values(given)


def _attenuation(given: str | AttenuationSettings) -> AttenuationSettings | Repetition | None:
    if isinstance(given, AttenuationSettings):
        return given
    _require_one_of('attenuation', given, ATTENUATIONS)
    if given == 'none':
        return None
    return Repetition() if given == REPETITIVE else AttenuationSettings(method=cast(Method, given))


def _feedback(pid: Sequence[float] | None) -> Feedback | None:
    if pid is None:
        return None
    if not (isinstance(pid, Sequence) and len(pid) == 3):
        raise CompensationError(f'pid is three gains, [V/m], [V/(m s)] and [V s/m], got {pid!r}')
    return Feedback('pid', PidGains(*pid))


def _require_one_of(what: str, given: object, known: tuple[str, ...]) -> None:
    if given not in known:
        nearest = near(given, known) if isinstance(given, str) else ''
        raise CompensationError(
            f'{what} {given!r} is unknown{nearest}; choose one of {", ".join(known)}'
        )
