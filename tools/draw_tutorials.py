"""Draw docs/pictures/tutorials/NAME.png: what a reader has in front of him after each tutorial.

    python tools/draw_tutorials.py [FOLDER]

FOLDER is one in which the first three tutorials were followed; without it they are followed in a
temporary one, which takes a minute.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.simulate import simulate
from piezo_hysteresis.records import Record, load
from piezo_hysteresis.reporting.plots import GREY, ROLES

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / 'docs' / 'tutorials'
FOLDER = ROOT / 'docs' / 'pictures' / 'tutorials'
BLOCK = re.compile(r'^```bash\n(.*?)^```$', re.MULTILINE | re.DOTALL)
MICRO = 1e6
LEAST = 1e-4  # of an amplitude that is drawn [µm]
NAMES = ('identify', 'compensate', 'discover')
RUNS = ('uncompensated', 'feedforward', 'attenuated')


def main() -> int:
    """Draw the pictures."""
    if len(sys.argv) > 1:
        draw(Path(sys.argv[1]))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        follow(Path(folder))
        draw(Path(folder))
    return 0


def follow(folder: Path, names: Sequence[str] = NAMES) -> None:
    """Type the commands of the tutorials in `folder`."""
    path = f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'
    for name in names:
        for block in BLOCK.findall((PAGES / f'{name}.md').read_text()):
            words = ['bash', '-e', '-c', block]
            subprocess.run(words, cwd=folder, env={**os.environ, 'PATH': path}, check=True)


def draw(folder: Path) -> None:
    """Draw what the tutorials left in `folder`."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures(folder).items():
        figure.savefig(FOLDER / f'{name}.png', dpi=80, metadata={'Software': None})


def pictures(folder: Path) -> dict[str, Figure]:
    """Return the picture of each tutorial."""
    return {'identify': _identify(folder), 'compensate': _compensate(folder),
            'discover': _discover(folder)}  # fmt: skip


def _new(columns: int) -> tuple[Figure, Any]:
    figure = Figure(figsize=(11.0, 3.2), layout='constrained')
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns)


def _rows(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / 'summary.json').read_text())
    return found


def _free_run(file: Path, record: Record) -> FloatArray:
    """Return the free run of a saved model over a record [m]."""
    return simulate(file, record)


def _identify(folder: Path) -> Figure:
    figure, axes = _new(3)
    record = next(r for r in load([str(folder / 'sweep')]) if r.name == 'sine_23Hz_1V')
    run = _free_run(folder / 'model' / 'model.yaml', record)
    tail = slice(-round(2 / (23.0 * record.dt)), None)
    axes[0].plot(record.voltage[tail], MICRO * record.displacement[tail], color=GREY, lw=4,
                 label='measured')  # fmt: skip
    axes[0].plot(
        record.voltage[tail], MICRO * run[tail], '--', color=ROLES['model'], label='model'
    )
    axes[0].set(xlabel='voltage [V]', ylabel='displacement [µm]', title='Loop at 23 Hz')
    axes[0].legend(frameon=False)

    summary = _rows(folder / 'model')
    rows = summary['records']
    sizes = {'error': [r['free_run_rms_m'] for r in rows]}
    _bars(axes[1], [_drive(r['record']) for r in rows], sizes, summary['noise_floor_rms_m'])
    axes[1].set_title('Free run of the eight sines')

    (check,) = load([str(folder / 'check.csv')])
    left = check.displacement - _free_run(folder / 'model' / 'model.yaml', check)
    axes[2].plot(check.time - check.time[0], MICRO * left, color=ROLES['error'], lw=0.8)
    axes[2].set(xlabel='time [s]', ylabel='measured minus model [µm]',
                title='A chirp that was not fitted')  # fmt: skip
    return figure


def _compensate(folder: Path) -> Figure:
    figure, axes = _new(2)
    runs = _rows(folder / 'attenuated')['runs']
    names = ['no compensation', 'feedforward', 'with attenuation']
    axes[0].bar(names, [MICRO * r['rms_m'] for r in runs], color=[ROLES[r] for r in RUNS])
    axes[0].set_yscale('log')
    axes[0].set(ylabel='rms tracking error [µm]', title='Remaining error at 23 Hz')
    orders = list(runs[0]['harmonics_m'])
    for k, (run, role) in enumerate(zip(runs, RUNS, strict=True)):
        sizes = [MICRO * run['harmonics_m'][order] for order in orders]
        places = np.arange(len(orders)) + 0.27 * (k - 1)
        axes[1].bar(places, sizes, 0.27, color=ROLES[role], label=names[k])
    axes[1].set_xticks(range(len(orders)), [f'{order}×' for order in orders])
    axes[1].set_yscale('log')
    axes[1].set_ylim(bottom=LEAST)
    axes[1].set(ylabel='amplitude of the error [µm]', title='By harmonic of the reference')
    axes[1].legend(frameon=False, fontsize='small')
    return figure


def _discover(folder: Path) -> Figure:
    figure, axes = _new(3)
    models = {'before': folder / 'blind' / 'model.yaml', 'after': folder / 'found' / 'model.yaml'}
    words = {'before': 'classical alone', 'after': 'with creep'}
    records = load([str(folder / 'hidden')])
    left = {
        role: {r.name: r.displacement - _free_run(file, r) for r in records}
        for role, file in models.items()
    }
    slow = min(records, key=lambda r: r.info.frequency)
    cut = slice(slow.warm_up_samples, None)
    for role, errors in left.items():
        axes[0].plot(slow.time[cut] - slow.time[0], MICRO * errors[slow.name][cut],
                     color=ROLES[role], lw=1.0, label=words[role])  # fmt: skip
        rms = [MICRO * np.std(errors[r.name][r.warm_up_samples :]) for r in records]
        axes[1].loglog([r.info.frequency for r in records], rms, 'o-', color=ROLES[role])
    axes[0].set(xlabel='time [s]', ylabel='measured minus model [µm]',
                title=f'Error at {slow.info.frequency:g} Hz')  # fmt: skip
    axes[0].set_ylim(top=1.4 * axes[0].get_ylim()[1])  # room for the legend
    axes[0].legend(frameon=False, fontsize='small', ncols=2)
    axes[1].set(xlabel='frequency of the drive [Hz]', ylabel='error, mean removed [µm rms]',
                title='Over the frequency')  # fmt: skip
    without, together = (_rows(folder / name)['records'] for name in ('without', 'with'))
    floor = json.loads((folder / 'found' / 'verdict.json').read_text())['noise_floor_rms_m']
    _bars(axes[2], [_drive(r['record']) for r in without],
          {'before': [r['free_run_rms_m'] for r in without],
           'after': [r['free_run_rms_m'] for r in together]},
          floor)  # fmt: skip
    axes[2].set_title('Records that no fit has seen')
    return figure


def _drive(record: str) -> str:
    """Return frequency and amplitude of a record by its name, ``sine_23Hz_0.5V``."""
    frequency, amplitude = record.removeprefix('sine_').removesuffix('V').split('Hz_')
    return f'{frequency} Hz\n{amplitude} V'


def _bars(axis: Any, names: list[str], sizes: dict[str, list[float]], floor: float) -> None:
    width = 0.8 / len(sizes)
    for k, (role, row) in enumerate(sizes.items()):
        places = np.arange(len(row)) + (k - (len(sizes) - 1) / 2) * width
        axis.bar(places, MICRO * np.array(row), width, color=ROLES[role])
    axis.axhline(MICRO * floor, color='k', ls=':', label='noise floor')
    axis.set_yscale('log')
    axis.set_xticks(range(len(names)), names, fontsize='small')
    axis.set_ylim(top=4 * axis.get_ylim()[1])  # room for the legend
    axis.set_ylabel('free-run error [µm rms]')
    axis.legend(frameon=False, fontsize='small')


if __name__ == '__main__':
    sys.exit(main())
