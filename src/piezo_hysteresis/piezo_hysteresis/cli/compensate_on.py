"""``compensate --on``: a wave in a controller tracks the reference, learnt from run to run."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.study import Run, Study, waveform_of
from piezo_hysteresis.drivers import open_controller
from piezo_hysteresis.drivers.tracking import Learning, LearntRun
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.records import Record, write_csv
from piezo_hysteresis.waveforms import Sine

#: The wave that tracked best, with displacement and reference.
WAVE = 'wave.csv'


def run_on(arguments: argparse.Namespace) -> int:
    """Learn on the controller, and write the results as of a study."""
    from piezo_hysteresis.reporting.compensation_folder import write_compensation

    started = time.perf_counter()
    reference = waveform_of(arguments.reference)
    if not isinstance(reference, Sine):
        raise CompensationError(
            'a controller learns a sine: --reference sine:frequency=23,amplitude=40e-6,duration=2'
        )
    model = ModelFile.load(arguments.model)
    with open_controller(
        arguments.on, arguments.axis, arguments.low, arguments.high, arguments.slew
    ) as controller:
        controller.open_loop()
        learning = Learning(controller, model, reference)
        runs = [_reported(each) for each in learning.runs(arguments.rounds)]
        study = Study(
            Controllers(learning.dt, controller.limits, model), '', reference,
            learning.from_seconds, controller=controller.identity.name,
        )  # fmt: skip
    out = Path(arguments.out)
    write_compensation(out, study, runs, arguments.reference, time.perf_counter() - started)
    _write_wave(out / WAVE, min(runs, key=lambda each: each.metrics.rms))
    print(f'written to {out}; open {out}/report.html')
    return 0


def _write_wave(path: Path, best: Run) -> None:
    """Write the wave of a run, with what was measured, to be loaded again."""
    path.unlink(missing_ok=True)
    found = best.result
    record = Record(
        best.name, found.dt, found.voltage, found.displacement, reference=found.reference
    )
    write_csv(path, record, unit='m')


def _reported(learnt: LearntRun) -> Run:
    """Print a line about a run, and return it as one of a study."""
    floors = f', {learnt.rms / learnt.noise:.3g} noise floors' if learnt.noise > 0.0 else ''
    print(f'{learnt.name:<18}{1e6 * learnt.rms:10.4f} µm rms{floors}', flush=True)
    return Run(learnt.name, learnt.result, learnt.metrics)
