"""Time of a step of an exported library per law; a real-time loop; comparison with the nodes.

    python bench/export.py [--steps 10000000] [--seconds 60] [--samples 8000] [--write]

Needs a C compiler. Every row is a library of its own, of the mode model with its defaults; the
times are of single steps between two readings of the clock, which is in them. The loop by the
clock sleeps to absolute times. The example tracks 23 Hz against the exported plant, whose
parameters it moves by 0.2 %. With --write the figures go to docs/target.json and from there into
docs/target.md; a test holds the page to the file.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench import export_beside as beside
from bench.quick import parsed
from piezo_hysteresis.cli.main import main as verb
from piezo_hysteresis.models import ModelFile, named

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIGURES = ROOT / 'docs' / 'target.md', ROOT / 'docs' / 'target.json'
#: What is between these two lines of the page is written by this program.
PLACE = re.compile(r'(<!--figures-->\n).*?(<!---->\n)', re.DOTALL)

GAINS = ('feedback.pid.proportional=100', 'feedback.pid.derivative=1')
PID = ('--set', 'feedback.method=pid', *GAINS)
FUZZY = ('--set', 'feedback.method=fuzzy_pid', *GAINS, 'feedback.fuzzy.proportional_range=50')
NONE = ('--set', 'attenuation.enabled=false')
ROWS: dict[str, tuple[str, ...]] = {
    'inverse + limits': NONE,
    'inverse + PID + limits': (*NONE, *PID),
    'inverse + fuzzy PID + limits': (*NONE, *FUZZY),
    'inverse + H-infinity + limits': (*NONE, 'feedback.method=h_infinity'),
    'inverse + rls of 4 orders + limits': (
        '--set',
        'attenuation.method=rls',
        'attenuation.orders=[1,2,3,5]',
    ),
    'inverse + afc of 5 orders + PID + limits': PID,
}


def built(folder: Path, model: Path, rate: float, words: Sequence[str]) -> Path:
    """Return the bench of a library that is exported with these words."""
    given = ['export', str(model), '--out', str(folder), '--rate', repr(rate), *words]
    if verb(given):
        raise SystemExit(f'{" ".join(given)} failed')
    subprocess.run(['make', '-s', '-C', folder, 'bench', 'example'], check=True)
    return folder / 'bench'


def said(*command: str | Path) -> str:
    """Return what a program prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def measured(folder: Path, path: Path, asked: argparse.Namespace) -> dict[str, Any]:
    """Return every figure of a run."""
    steps: dict[str, Any] = {}
    for k, (name, words) in enumerate(list(ROWS.items())[: asked.laws]):
        bench = built(folder / f'lib{k}', path, asked.rate, words)
        steps[name] = json.loads(said(bench, '0', str(asked.steps)))
    clock = json.loads(said(bench, str(asked.seconds)))
    example = said(bench.parent / 'example')
    model = ModelFile.load(path)
    rows: list[beside.Row] = []
    if asked.samples:
        rows = beside.library(path, folder / 'beside', asked.samples, asked.steps)
        rows = [beside.offline(model, asked.samples), *rows]
    if asked.samples > beside.SHORTEST:
        rows = [*beside.live(model, path, asked.samples), *rows]
    return {
        'rate': asked.rate,
        'steps': steps,
        'clock': clock,
        'example': [float(each) for each in re.findall(r'([\d.]+) um', example)],
        'beside': [row._asdict() for row in rows],
    }


def shown(found: Mapping[str, Any]) -> str:
    """Return the part of the page that a run writes."""
    lines = ['| one step [ns] | median | 99.9 % | worst |', '|---|---:|---:|---:|']
    for name, row in found['steps'].items():
        numbers = (f'{row[key]:.0f}' for key in ('median_ns', 'p999_ns', 'worst_ns'))
        lines.append('| ' + ' | '.join([name, *numbers]) + ' |')
    count = next(iter(found['steps'].values()))['steps']
    lines += ['', f'{count} steps each; the times include two readings of the clock.', '']
    lines += _example(found['example'], found['rate']) + _clock(found['clock'], found['rate'])
    lines += [
        'The same loop (inverse, `afc` of the orders 0, 1, 3, limits) on the same simulated',
        'actuator at 1 kHz, at full speed. The CPU time of the nodes includes all processes, that',
        'of the others excludes the actuator:',
        '',
        '| loop | samples/s | CPU per sample [µs] | rms error [µm] |',
        '|---|---:|---:|---:|',
    ]
    for row in found['beside']:
        error = f'{1e6 * row["rms"]:.6f}' if row['rms'] is not None else ''
        lines.append(f'| {row["name"]} | {row["rate"]:.0f} | {row["cpu"]:.3g} | {error} |')
    return '\n'.join(['', *lines, '', ''])


def _example(errors: Sequence[float], rate: float) -> list[str]:
    words = ('rms without compensation', 'with feedforward', 'with `afc` of five orders and PID')
    parts = [f'{error:.4f} µm {how}' for error, how in zip(errors, words, strict=False)]
    return [
        f'`make run` tracks 23 Hz at {rate:g} Hz on the plant with parameters changed by 0.2 %:',
        *(',\n'.join(parts) + '.').splitlines(),
        '',
    ]


def _clock(clock: Mapping[str, Any], rate: float) -> list[str]:
    late = 100.0 * clock['late'] / clock['ticks']
    woken, worst = 1e-3 * clock['mean_wake_ns'], 1e-6 * clock['worst_wake_ns']
    return [
        f'In a timed loop at {rate:g} Hz, {late:.3g} % of {clock["ticks"]} ticks were late. The',
        'virtual machine of this measurement wakes a sleeping thread',
        f'{woken:.0f} µs late in the mean and {worst:.1f} ms at worst.',
        f'The delay does not change the samples: {1e9 * clock["rms_m"]:.2g} nm rms on a plant',
        'equal to the model. Repeat the timed loop (`./bench 60`) on the target machine.',
        '',
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print what the page shows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--steps', type=int, default=10_000_000)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=20000.0)
    parser.add_argument('--laws', type=int, default=len(ROWS), help='so many of the table')
    parser.add_argument(
        '--samples', type=int, default=8000, help='of the loops beside it; 0: none'
    )
    parser.add_argument('--write', action='store_true', help='into docs/target.md')
    asked = parsed(parser, arguments, laws=1, steps=20_000, seconds=0.5, samples=0)
    model = named('bouc_wen_mode')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'model.yaml'
        ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(path)
        found = measured(Path(folder), path, asked)
    print(shown(found))
    if asked.write:
        FIGURES.write_text(json.dumps(found, indent=1) + '\n', 'utf-8')
        PAGE.write_text(written(PAGE.read_text('utf-8'), found), 'utf-8')
    return 0


def written(page: str, found: Mapping[str, Any]) -> str:
    """Return the page with the figures of a run."""
    return PLACE.sub(lambda part: f'{part[1]}{shown(found)}{part[2]}', page)


if __name__ == '__main__':
    sys.exit(main())
