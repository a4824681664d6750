"""The runs behind ``compensate``: from no compensation to everything that was asked for."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from piezo_hysteresis.cli.compensate_links import Builder, Feedback, Repetition
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.compensation.harmonics.attenuation_settings import AttenuationSettings
from piezo_hysteresis.compensation.inverses.reach import require_reachable
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.model_plant import ModelPlant
from piezo_hysteresis.compensation.offline_loop import (
    LoopResult,
    TrackingMetrics,
    closed_loop,
    tracking_metrics,
)
from piezo_hysteresis.compensation.process_plant import simulated
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.waveforms import Waveform, from_spec, has_setting
from piezo_hysteresis.waveforms.waveform import Samples


@dataclass(frozen=True)
class Study:
    """Everything that a study is made of; times in s, voltages in V, displacements in m.

    The plant is a model, or the name of a preset of the simulator; of an actuator on a controller
    the latter has a name.
    """

    model: ModelFile
    slow: ModelFile | None
    law: str
    switch: float
    plant: ModelFile | str
    waveform: Waveform
    dt: float
    limits: Limits
    attenuation: AttenuationSettings | Repetition | None
    gain_model: ModelFile | None
    feedback: Feedback | None
    together: bool
    noise: float
    seed: int
    from_seconds: float
    controller: str = ''


@dataclass(frozen=True)
class Run:
    """One run of a study."""

    name: str
    result: LoopResult
    metrics: TrackingMetrics
    words: tuple[str, ...] = ()


def parse_reference(text: str, usual: Mapping[str, float] | None = None) -> Waveform:
    """Return the waveform that ``KIND:setting=value,...`` describes.

    Parameters
    ----------
    text : str
        What the user wrote.
    usual : mapping, optional
        Settings for a waveform that has them, where the user gave none.

    Raises
    ------
    PiezoError
        If it is malformed, or the kind or a setting is unknown.
    """
    kind, _, rest = text.partition(':')
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


def run_study(study: Study, plant: ResettablePlant) -> list[Run]:
    """Run the reference without compensation, with the inverse, and with each further link.

    Parameters
    ----------
    study : Study
        What is run.
    plant : ResettablePlant
        What is driven, from `open_plant`.

    Raises
    ------
    CompensationError
        If the reference is out of reach, or a link cannot be built.
    """
    ticks = max(2, round(study.waveform.duration / study.dt))
    time = np.arange(ticks, dtype=np.float64) * study.dt
    samples = study.waveform.sample(time)
    Limiter(study.limits, study.dt)  # refuses what are none
    require_reachable(samples.value, study.model.model, study.model.values, study.dt, study.limits)
    return [_run(study, name, links, samples, plant) for name, links in _chains(study)]


class ResettablePlant(Protocol):
    """A plant that can be put back to rest."""

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; answer the displacement before it acts [m]."""

    def reset(self) -> None:
        """Go back to rest, with the same noise."""


@contextmanager
def open_plant(
    plant: ModelFile | str, dt: float, seed: int, *, noise: float, settings: Sequence[str]
) -> Iterator[tuple[ResettablePlant, Mapping[str, Any]]]:
    """Open a plant; yield it and what it is known to be, which of a model is nothing.

    Parameters
    ----------
    plant : ModelFile or str
        A model in the place of the actuator, or the name of a preset of the simulator.
    dt : float
        Sampling interval [s].
    seed : int
        Of the noise.
    noise : float
        Its rms for a model [m].
    settings : sequence of str
        ``NAME=VALUE`` for a simulated actuator.
    """
    if isinstance(plant, ModelFile):
        yield ModelPlant(plant.model, plant.values, dt, noise=noise, seed=seed), {}
        return
    actuator = simulated(plant, 1.0 / dt, seed, settings)
    try:
        yield actuator, actuator.about
    finally:
        actuator.close()


def _run(
    study: Study, name: str, links: list[Link], samples: Samples, plant: ResettablePlant
) -> Run:
    plant.reset()
    result = closed_loop(samples, links, plant, study.limits, study.dt)
    remarks = tuple(filter(None, (getattr(link, 'words', '') for link in links)))
    remarks += _limited(name, result, study.limits)
    return Run(name, result, tracking_metrics(result, study.from_seconds), remarks)


def _limited(name: str, result: LoopResult, limits: Limits) -> tuple[str, ...]:
    """Return how much of a run the limiter changed, as a sentence, where it did."""
    counts = result.counters['limiter']
    causes = {
        'slew_limited': f'--slew {limits.slew:g} V/s',
        'out_of_range': f'the range {limits.low:g} to {limits.high:g} V',
        'not_finite': 'voltages that were no numbers',
    }
    found = [f'{counts[key]} by {cause}' for key, cause in causes.items() if counts[key]]
    if not found:
        return ()
    return (f'{name}: of {result.time.size} samples limited {", ".join(found)}',)


def _chains(study: Study) -> list[tuple[str, list[Link]]]:
    build = Builder(
        study.model, study.slow, study.law, study.switch, study.dt, study.limits,
        study.gain_model,
    )  # fmt: skip
    chains: list[tuple[str, list[Link]]] = [
        ('no compensation', [build.straight()]),
        ('feedforward', [build.inverse()]),
    ]
    both: list[Link] = []
    if study.attenuation is not None:
        chains.append(
            ('with attenuation', [build.inverse(), build.attenuation(study.attenuation)])
        )
        both.append(build.attenuation(study.attenuation))
    if study.feedback is not None:
        with_law = [build.inverse(), build.feedback(study.feedback)]
        chains.append((f'with {study.feedback.name}', with_law))
        both.append(build.feedback(study.feedback))
    if study.together and len(both) == 2:
        chains.append(('with both', [build.inverse(), *both]))
    return chains


def write_results(
    out: Path, study: Study, runs: list[Run], reference: str, seconds: float
) -> None:
    """Write ``summary.json``, ``report.html`` and ``tracking.png``, whole or not at all.

    Raises
    ------
    PiezoError
        If the folder cannot be written, or holds the results of another verb.
    """
    from piezo_hysteresis.reporting.compensation_report import compensation_page

    summary: dict[str, Any] = {
        'model': study.model.model.name,
        'plant': (
            study.plant.model.name
            if isinstance(study.plant, ModelFile)
            else study.controller or f'preset:{study.plant}'
        ),
        'law': study.law,
        'gain_model': (study.gain_model or study.model).model.name,
        'notes': list(dict.fromkeys(remark for each in runs for remark in each.words)),
        'reference': reference,
        'rate_hz': 1.0 / study.dt,
        'from_seconds': study.from_seconds,
        'noise_rms_m': study.noise,
        'seed': study.seed,
        'runs': [_row(each) for each in runs],
        'seconds': seconds,
    }
    page = compensation_page(
        runs, summary['model'], summary['plant'], reference, study.from_seconds
    )
    files: dict[str, bytes | str] = {
        'summary.json': json.dumps(summary, indent=2) + '\n',
        'report.html': page,
        'tracking.png': _figure(runs),
    }
    write_folder(out, files, 'compensate')


def _row(run: Run) -> dict[str, Any]:
    m = run.metrics
    return {
        'run': run.name,
        'rms_m': m.rms,
        'rms_without_mean_m': m.rms_without_mean,
        'largest_m': m.largest,
        'mean_m': m.mean,
        'harmonics_m': {str(order): amplitude for order, amplitude in m.harmonics.items()},
        'counters': run.result.counters,
    }


def _figure(runs: list[Run]) -> bytes:
    import io

    from matplotlib.figure import Figure

    from piezo_hysteresis.reporting.compensation_report import colour_of

    figure = Figure(figsize=(9, 7), layout='constrained')
    whole, last = figure.subplots(2, 1)
    for each in runs:
        result = each.result
        part = slice(-min(result.time.size, max(200, result.time.size // 50)), None)
        label = f'{each.name}: rms {each.metrics.rms * 1e6:.3g} µm'
        colour = colour_of(each)
        whole.plot(result.time, result.error * 1e6, lw=0.7, label=label, color=colour)
        if each is not runs[0]:  # beside it the others are one line
            error = result.error[part] * 1e6
            last.plot(result.time[part], error, lw=1.2, color=colour)
    whole.set(title='Tracking error', ylabel='error [µm]')
    whole.legend(loc='upper right')
    last.set(xlabel='time [s]', ylabel='error [µm]', title='The end of the compensated runs')
    for axis in (whole, last):
        axis.grid(alpha=0.3)
    picture = io.BytesIO()
    figure.savefig(picture, format='png', dpi=110)
    return picture.getvalue()
