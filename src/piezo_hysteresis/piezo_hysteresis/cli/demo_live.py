"""Experiment of the demo: sweep, identification and three tracking runs over live nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.compensation.offline_loop import (
    LoopResult,
    TrackingMetrics,
    tracking_metrics,
)
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.identify import Identification, identify
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.demo_report import LiveRun, Plan

Progress = Callable[[float, str], None]

PRESET = 'fdk_pzba_00030'
MODEL = 'bouc_wen_mode'
REPORTED = (1, 2, 3, 5)


@dataclass(frozen=True)
class Demo:
    """All results of the demo."""

    plan: Plan  # settings of the demo
    sweep: tuple[Record, ...]  # open-loop records
    found: Identification  # model identified from the sweep
    runs: tuple[LiveRun, ...]  # no compensation, feedforward, feedforward and attenuation
    seconds: dict[str, float]  # wall time of each part [s]

    def summary(self) -> dict[str, Any]:
        """Return the content of ``summary.json``: identification and tracking errors."""
        return {
            **self.found.summary(),
            'tracking': {
                'frequency_hz': self.plan.tracked,
                'judged_seconds': self.plan.judged_seconds,
                'runs': [
                    {
                        'name': run.name,
                        'rmse_m': run.metrics.rms,
                        'rmse_without_mean_m': run.metrics.rms_without_mean,
                        'mean_m': run.metrics.mean,
                        'largest_m': run.metrics.largest,
                        'harmonics_m': {str(n): a for n, a in run.metrics.harmonics.items()},
                    }
                    for run in self.runs
                ],
            },
            'parts_seconds': {name: round(lap, 3) for name, lap in self.seconds.items()},
        }


def run_demo(plan: Plan, folder: Path, progress: Progress) -> Demo:
    """Run the complete demo; write ``model.yaml`` and the bags to `folder`."""
    with ros_needed():
        from piezo_hysteresis.nodes import live
    clock = _Clock()
    fields = {
        'frequencies': [float(each) for each in plan.frequencies],
        'amplitudes': [float(each) for each in plan.amplitudes],
        'seconds': plan.seconds,
        'warm_up': plan.warm_up,
    }
    progress(0.0, 'starting the nodes')
    with _advice():
        sweep = live.record_sweep(
            PRESET,
            fields,
            folder / 'bags' / 'sweep',
            progress=lambda fraction, words: progress(0.3 * fraction, f'sweep: {words}'),
        )
    clock.lap('sweep')
    progress(0.3, f'identifying {MODEL}')
    found = identify(sweep, named(MODEL))
    found.model_file(['bags/sweep'], sweep[0].rate).save(folder / 'model.yaml')
    clock.lap('identification')
    gain = _gain(sweep, plan)
    runs = []
    for k, (name, settings) in enumerate(_settings(gain, folder).items()):
        progress((0.4, 0.55, 0.7)[k], f'tracking {plan.tracked:g} Hz: {name}')
        bag = folder / 'bags' / name.replace(' + ', '_and_').replace(' ', '_')
        learning = plan.learning_seconds if settings['attenuation'].get('enabled', True) else 0.0
        reference = {
            'frequency': plan.tracked,
            'reference.amplitude': gain * plan.amplitudes[-1],
            'reference.offset': found.values['offset'],
            'duration': plan.tracking_seconds + learning,
        }
        with _advice():
            record = live.track(PRESET, reference, bag, **settings)
        runs.append(LiveRun(name, record, _metrics(record, plan)))
        clock.lap(name)
    return Demo(plan, tuple(sweep), found, tuple(runs), clock.laps)


@contextmanager
def _advice() -> Iterator[None]:
    try:
        yield
    except PiezoError as error:
        raise PiezoError(
            f'{error}; nothing was written: run the demo again, or that node alone to see why'
        ) from error


class _Clock:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now


def _gain(sweep: Sequence[Record], plan: Plan) -> float:
    """Return the displacement per volt at the tracked frequency [m/V], as in Fujii 2018."""
    record = min(sweep, key=lambda r: (abs(r.info.frequency - plan.tracked), -r.info.amplitude))
    u, y = (x[record.warm_up_samples :] for x in (record.voltage, record.displacement))
    return float((y - np.mean(y)) @ u / (u @ u))


def _settings(gain: float, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters of feedforward and attenuation for each run."""
    inverse = {'model_file': str(folder / 'model.yaml')}
    off = {'enabled': False}
    return {
        'no compensation': {'feedforward': {'gain': gain}, 'attenuation': off},
        'feedforward': {'feedforward': inverse, 'attenuation': off},
        'feedforward + attenuation': {'feedforward': inverse, 'attenuation': inverse},
    }


def _metrics(record: Record, plan: Plan) -> TrackingMetrics:
    assert record.reference is not None
    seconds = np.arange(len(record), dtype=np.float64) * record.dt
    result = LoopResult(
        dt=record.dt,
        reference=record.reference,
        voltage=record.voltage,
        displacement=record.displacement,
        phase=np.asarray(2 * np.pi * plan.tracked * seconds, np.float64),
        link_voltages=np.empty((0, len(record))),
        counters={},
    )
    return tracking_metrics(result, record.duration - plan.judged_seconds, orders=REPORTED)
