"""Runs a reference on a plant: from no compensation to everything that was asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any, ClassVar, Protocol

import numpy as np

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.drive_selection import entry_of
from piezo_hysteresis.compensation.inverses.reach import require_reachable
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import (
    LoopPlant,
    LoopResult,
    ModelPlant,
    TrackingMetrics,
    closed_loop,
    simulated,
    tracking_metrics,
)
from piezo_hysteresis.compensation.operating_limits import (
    above_nyquist,
    limited_samples,
    operating_limits,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.waveforms import Waveform, from_spec, has_setting
from piezo_hysteresis.waveforms.waveform import Samples

PRESET = 'preset:'


@dataclass(frozen=True)
class Run(Guided):
    """One run of a study."""

    _INSTEAD: ClassVar = {
        'metrics.rms': 'rms rmse',
        'result.error': 'error',
        'result.voltage': 'u voltage',
        'result.displacement': 'y displacement',
        'result.time': 'time',
        'result.reference': 'reference',
    }

    name: str
    result: LoopResult
    metrics: TrackingMetrics
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Study:
    """Everything that a study is made of; times in s, displacements in m.

    The plant is a model, or the name of a preset of the simulator, of which `about` holds what it
    is known to be; of an actuator on a controller the latter has a name.
    """

    controllers: Controllers
    plant: ModelFile | str
    waveform: Waveform
    from_seconds: float
    together: bool = False
    noise: float = 0.0
    seed: int = 0
    controller: str = ''
    about: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def model(self) -> ModelFile:
        """What is inverted."""
        assert self.controllers.model is not None
        return self.controllers.model

    @property
    def limits(self) -> Limits:
        """Of the voltage."""
        return self.controllers.limits


def track(
    controllers: Controllers,
    plant: ModelFile | str,
    reference: str | Waveform,  # [m]
    *,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    together: bool = False,
    noise: float = 0.0,
    seed: int = 0,
    from_seconds: float | None = None,  # [s]
    plant_settings: Sequence[str] = (),
) -> tuple[Study, list[Run]]:
    """Run the reference without compensation, with the inverse, and with each further link."""
    for name, value in {'noise': noise, 'seed': seed, 'from_seconds': from_seconds or 0.0}.items():
        if not (isinstance(value, Real) and math.isfinite(value) and value >= 0):
            raise CompensationError(f'{name} must be a number of 0 or more, got {value!r}')
    dt = controllers.dt
    asked = waveform_of(reference)  # refused before a plant is started
    if isinstance(plant, ModelFile):
        plant = entry_of(plant, _sampled(asked, dt), dt)
    with open_plant(plant, dt, seed, noise=noise, settings=plant_settings) as (driven, about):
        usual = {'offset': about.get('offset_m', 0.0), 'phase': about.get('phase', 0.0)}
        waveform = waveform_of(reference, {k: v for k, v in usual.items() if v})
        bounds = operating_limits(controllers.model, low=low, high=high, slew=slew, plant=about)
        study = Study(
            replace(controllers, limits=bounds.limits), plant, waveform,
            0.5 * waveform.duration if from_seconds is None else from_seconds,
            together, noise, seed, about=about,
            warnings=(*bounds.warnings, *above_nyquist(controllers.model, dt)),
        )  # fmt: skip
        return study, _runs(study, driven)


def remarks(study: Study, runs: Sequence[Run]) -> tuple[str, ...]:
    """Return every sentence about the settings and the runs, each once."""
    remarks = (sentence for run in runs for sentence in run.words)
    return tuple(dict.fromkeys((*study.warnings, *remarks)))


def waveform_of(reference: str | Waveform, usual: Mapping[str, float] | None = None) -> Waveform:
    """Return the waveform that ``KIND:setting=value,...`` describes, a waveform as it is."""
    if not isinstance(reference, str):
        if hasattr(reference, 'sample') and hasattr(reference, 'duration'):
            return reference
        raise CompensationError(
            "a reference is text such as 'sine:frequency=23,amplitude=80e-6,duration=4' or a "
            f'Waveform, not of type {type(reference).__name__}'
        )
    kind, _, rest = reference.partition(':')
    spec: dict[str, Any] = {'kind': kind}
    for part in filter(None, rest.split(',')):
        key, equals, value = part.partition('=')
        if not equals:
            raise CompensationError(
                f'the reference says {part!r}; write KIND:setting=value,..., e.g. '
                'sine:frequency=23,amplitude=120e-6'
            )
        spec[key.strip()] = _value(value)
    for name, default in (usual or {}).items():
        if has_setting(kind, name):
            spec.setdefault(name, default)
    return from_spec(spec)


def _value(text: str) -> Any:
    try:
        return float(text) if any(c in text for c in '.eE') else int(text)
    except ValueError:
        return plain_yaml.load(text.replace(' ', ', ')) if text.startswith('[') else text


def require_sampled(waveform: Waveform, rate: float) -> None:
    """Refuse a reference that the rate [Hz] cannot sample, and one without an end."""
    frequency = float(getattr(waveform, 'frequency', 0.0))
    if frequency >= 0.5 * rate:
        raise CompensationError(
            f'a reference of {frequency:g} Hz cannot be sampled at {rate:g} Hz; lower the '
            'frequency or raise the rate'
        )
    if not math.isfinite(waveform.duration) or waveform.duration * rate > 5e7:
        raise CompensationError('the reference is too long; give it a duration')


class ResettablePlant(LoopPlant, Protocol):
    """A plant that can be put back to rest."""

    def reset(self) -> None:
        """Go back to rest, with the same noise."""


@contextmanager
def open_plant(
    plant: ModelFile | str, dt: float, seed: int, *, noise: float, settings: Sequence[str]
) -> Iterator[tuple[ResettablePlant, Mapping[str, Any]]]:  # dt [s]; noise [m]
    """Open a plant; yield it and what it is known to be, which of a model is nothing."""
    if isinstance(plant, ModelFile):
        yield ModelPlant(plant.model, plant.values, dt, noise=noise, seed=seed), {}
        return
    actuator = simulated(plant, 1.0 / dt, seed, settings)
    try:
        if (axes := int(actuator.about.get('axes', 1))) != 1:
            raise CompensationError(
                f'the plant has {axes} axes, the model one; give a preset of one axis, or a model '
                'of several (identify --model modes)'
            )
        yield actuator, actuator.about
    finally:
        actuator.close()


def _runs(study: Study, plant: ResettablePlant) -> list[Run]:
    dt, model, limits = study.controllers.dt, study.model, study.limits
    samples = _sampled(study.waveform, dt)
    Limiter(limits, dt)  # refuses what are none
    own = entry_of(model, samples, dt)
    require_reachable(samples.value, own.model, own.values, dt, limits)
    return [_run(study, name, links, samples, plant) for name, links in _chains(study)]


def _sampled(waveform: Waveform, dt: float) -> Samples:
    """Return all samples of a reference, refusing one that cannot be sampled."""
    require_sampled(waveform, 1.0 / dt)
    ticks = max(2, round(waveform.duration / dt))
    return waveform.sample(np.arange(ticks, dtype=np.float64) * dt)


def _run(
    study: Study, name: str, links: list[Link], samples: Samples, plant: ResettablePlant
) -> Run:
    plant.reset()
    result = closed_loop(samples, links, plant, study.limits, study.controllers.dt)
    remarks = tuple(filter(None, (getattr(link, 'words', '') for link in links)))
    counts = limited_samples(study.limits, result.counters['limiter'], result.time.size)
    remarks += (*(f'{name}: {each}' for each in counts), *_uneven_period(study, result))
    remarks += _unstarted_links(name, result)
    return Run(name, result, tracking_metrics(result, study.from_seconds), remarks)


def _unstarted_links(name: str, result: LoopResult) -> tuple[str, ...]:
    """Return a sentence about an attenuation that evaluated no window of the error."""
    if all(each.get('windows', 1) for each in result.counters.values()):
        return ()
    length = result.time.size * result.dt
    sentence = (
        f'{name}: {length:.3g} s are too short for the attenuation, which corrected nothing; give '
        'the reference a longer duration'
    )
    return (sentence,)


def _uneven_period(study: Study, result: LoopResult) -> tuple[str, ...]:
    """Return a sentence about corners that are sampled at another phase in every period."""
    dt, frequency = study.controllers.dt, float(getattr(study.waveform, 'frequency', 0.0))
    corners = max((each.get('corners', 0) for each in result.counters.values()), default=0)
    ticks = 1.0 / (frequency * dt) if frequency > 0.0 else 0.0
    if corners < 2 or abs(ticks - round(ticks)) < 1e-6 * ticks:
        return ()
    whole = 1.0 / (round(ticks) * dt)
    sentence = (
        f'a period of the reference is {ticks:.2f} samples: its corners between samples excite '
        f'the mode at frequencies that are no harmonics; {whole:.6g} Hz has a whole number'
    )
    return (sentence,)


def _chains(study: Study) -> list[tuple[str, list[Link]]]:
    whole = study.controllers
    inverse = replace(whole, attenuation=None, feedback=None)
    chains = [('no compensation', [whole.straight()]), ('feedforward', inverse.links())]
    if whole.attenuation is not None:
        chains.append(('with attenuation', replace(whole, feedback=None).links()))
    if whole.feedback is not None:
        chains.append((f'with {whole.feedback.name}', replace(whole, attenuation=None).links()))
    if study.together and whole.attenuation is not None and whole.feedback is not None:
        chains.append(('with both', whole.links()))
    return chains
