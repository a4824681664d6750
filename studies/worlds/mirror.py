"""The measured mirror of three piezos: a modal model, found step by step from its training sets.

The CubeSpec Fine Steering Mirror benchmark (nonlinearbenchmark.org, CC BY 4.0): three voltages,
three displacements, 6.4 kHz, orthogonal multisines of three amplitudes. The last realisation of
each amplitude is held out; the steps, the number of modes and the effects are chosen on it. The
metric is that of the benchmark: the rms error over time, then the mean over outputs, realisations
and periods.

    python studies/study.py mirror --workers 2 --out out/mirror --test FOLDER
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.modal_file import save
from piezo_hysteresis.axes.modal_model import ModalModel
from piezo_hysteresis.axes.modal_search import ModalIdentification, identify_axes, levels_of

RATE = 6400.0
FOLDER = Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'fsm'
# Published on the test sets, one model for all amplitudes [um].
PUBLISHED = {
    'linear': (0.252, 0.179, 0.658),
    'NL-LFR with a neural network': (0.0866, 0.1309, 0.1686),
    'noise floor': (0.0127, 0.0222, 0.0311),
}
QUICK: dict[str, Any] = {'effects': ['voltage_powers'], 'modes': 6, 'levels': ['100mV']}
LEVELS = ['100mV', '200mV', '300mV']
MICRO = 1e6


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--train', type=Path, default=FOLDER, help='folder of u_*.npy and y_*.npy')
    add('--test', type=Path, help='folder of test sets, u_*.npy and y_*.npy')
    add('--out', type=Path, help='folder for model.yaml')
    add('--modes', type=int, help='poles of the linear start; selected by default')
    add('--levels', nargs='+', default=LEVELS, choices=LEVELS, help='amplitudes to fit')
    add('--effects', nargs='+', help='effects to add in this order; tried one by one by default')


def read(folder: Path, levels: Sequence[str]) -> list[AxesRecord]:
    """Return the records of a folder of the benchmark."""
    records = load_axes(folder, fs=RATE, voltage='u*', displacement='y*')
    return [each for each in records if each.level in levels]


def metric(model: ModalModel, records: Sequence[AxesRecord]) -> list[float]:
    """Return the error of the benchmark by level [m]."""
    found = []
    for those in levels_of(records).values():
        errors = [
            (each.displacement - model.simulate(each)).reshape(
                each.periods, -1, model.layout.outputs
            )
            for each in those
        ]
        found.append(float(np.mean([np.sqrt(np.mean(error**2, 1)) for error in errors])))
    return found


def floor(records: Sequence[AxesRecord]) -> list[float]:
    """Return the metric of a perfect model, from the difference of two periods, by level [m]."""
    return [
        float(np.mean([np.asarray(each.noise) for each in those]))
        for those in levels_of(records).values()
    ]


def one_record(model: ModalModel, record: AxesRecord) -> float:
    """Return the median time that the simulation of one record takes, once compiled [s]."""
    taken = []
    for _ in range(20):
        again = replace(record)  # what a record is driven by is kept with it
        started = time.perf_counter()
        model.simulate(again)
        taken.append(time.perf_counter() - started)
    return float(np.median(taken[1:]))


def identified(asked: argparse.Namespace) -> tuple[ModalIdentification, list[AxesRecord]]:
    """Identify, and return the records as well."""
    records = read(asked.train, asked.levels)
    found = identify_axes(
        records, modes=asked.modes, effects=asked.effects, workers=asked.workers,
        report=lambda line: print(line, flush=True),
    )  # fmt: skip
    return found, records


def run(asked: argparse.Namespace) -> str:
    """Identify, and return the steps and errors as a page."""
    began, on_cores = time.perf_counter(), time.process_time()
    found, records = identified(asked)
    passed, on_cores = time.perf_counter() - began, time.process_time() - on_cores
    if asked.out:
        asked.out.mkdir(parents=True, exist_ok=True)
        save(found.model, asked.out / 'model.yaml')
    held = [each for each in records if each.name in found.held_out]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # [MiB]
    cost = f'{passed:.0f} s, {on_cores:.0f} s of processor time, {memory:.0f} MiB'
    one = f'one record is simulated in {1e3 * one_record(found.model, held[-1]):.1f} ms'
    lines = [*_steps(found), '', f'{cost}; {one}.', '']
    rows = {'held-out realisations': metric(found.model, held), 'their noise floor': floor(held)}
    if asked.test:
        test = read(asked.test, asked.levels)
        rows |= {
            'test sets': metric(found.model, test),
            'noise floor of the test sets': floor(test),
        }
    levels = list(levels_of(records))
    lines += ['| error [um] | ' + ' | '.join(levels) + ' |', '|---|' + '---:|' * len(levels)]
    lines += [_row(name, [MICRO * each for each in row]) for name, row in rows.items()]
    shown = [LEVELS.index(each) for each in levels]
    for name, row in PUBLISHED.items():
        lines.append(_row(f'published, test sets: {name}', [row[k] for k in shown]))
    return '\n'.join(lines)


def _row(name: str, values: Sequence[float]) -> str:
    return f'| {name} | ' + ' | '.join(f'{each:.4f}' for each in values) + ' |'


def _steps(found: ModalIdentification) -> list[str]:
    """Return the table of the steps: what was added, and the held-out error after it."""
    levels = list(found.steps[0].held_out)
    lines = ['| step | added | ' + ' | '.join(f'{each} [um]' for each in levels) + ' |']
    lines.append('|---|---|' + '---:|' * len(levels))
    for step in found.steps:
        errors = ' | '.join(f'{MICRO * step.held_out[each]:.4f}' for each in levels)
        lines.append(f'| `{step.effect}` | {step.sentence} | {errors} |')
    if found.disturbed:
        lines += ['', f'Left out as disturbed: {", ".join(found.disturbed)}.']
    return lines
