"""How long a step of an exported library takes, per law, and a loop by the clock on its plant.

    python bench/export.py [--steps 10000000] [--seconds 60] [--rate 20000]

Needs a C compiler. Every row is a library of its own, of the mode model with its defaults; the
times are of single steps between two readings of the clock, which is in them. The loop sleeps to
absolute times; the last line is the same chain in Python.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from piezo_hysteresis.cli.main import main as verb
from piezo_hysteresis.compensation.base import Limits, Measured
from piezo_hysteresis.compensation.feedback.pid import Pid, PidGains
from piezo_hysteresis.compensation.harmonics.attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.inverses.choice import inverse_for
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.loop import reference_points
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.waveforms import Sine

PID = ('--pid', '100', '3e4', '1')
FUZZY = ('--feedback', 'fuzzy_pid', *PID, '--fuzzy', '5e-6', '1e-3', '50', '1e4')
NONE = ('--attenuation', 'none')
ROWS: dict[str, tuple[str, ...]] = {
    'inverse + limits': NONE,
    'inverse + PID + limits': (*NONE, *PID),
    'inverse + fuzzy PID + limits': (*NONE, *FUZZY),
    'inverse + H-infinity + limits': (*NONE, '--feedback', 'h_infinity', '--bandwidth', '2'),
    'inverse + rls of 4 orders + limits': ('--attenuation', 'rls', '--orders', '1', '2', '3', '5'),
    'inverse + afc of 5 orders + PID + limits': PID,
}


def built(folder: Path, model: Path, rate: float, words: Sequence[str]) -> Path:
    """Return the bench of a library that is exported with these words."""
    given = ['export', str(model), '--out', str(folder), '--rate', repr(rate), *words]
    if verb(given):
        raise SystemExit(f'{" ".join(given)} failed')
    subprocess.run(['make', '-s', '-C', folder, 'bench'], check=True)
    return folder / 'bench'


def in_python(model: ModelFile, rate: float, ticks: int) -> float:
    """Return microseconds of processor time of one step of the last row, in Python."""
    dt, limits = 1.0 / rate, Limits(-1.2, 1.2, 2000.0)
    gain = ModeGain(1e-4, float(model.values['natural_frequency']), 0.02, dt)
    chain = (
        inverse_for(model.model, model.values, dt, limits=limits),
        HarmonicAttenuation(AttenuationSettings(), gain, dt),
        Pid(PidGains(100.0, 3e4, 1.0), dt, limits=limits),
    )
    limiter, measured = Limiter(limits, dt), None
    samples = Sine(1e-4, 23.0, ticks * dt).sample(np.arange(ticks, dtype=np.float64) * dt)
    begun = time.process_time()
    for point in reference_points(samples):
        voltage = 0.0
        for link in chain:
            voltage = link.step(point, voltage, measured)
        voltage = limiter.apply(voltage)
        measured = Measured(point.sample, voltage, point.displacement)
    return 1e6 * (time.process_time() - begun) / ticks


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--steps', type=int, default=10_000_000)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=20000.0)
    asked = parser.parse_args(arguments)
    model = named('bouc_wen_mode')
    file = ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'model.yaml'
        file.save(path)
        print(f'{"ns per step":<44}{"median":>8}{"99.9 %":>8}{"worst":>10}')
        for k, (name, words) in enumerate(ROWS.items()):
            bench = built(Path(folder) / f'lib{k}', path, asked.rate, words)
            done = subprocess.run(
                [bench, '0', str(asked.steps)], check=True, capture_output=True, text=True
            )
            row = json.loads(done.stdout)
            numbers = (row['median_ns'], row['p999_ns'], row['worst_ns'])
            print(f'{name:<44}{numbers[0]:>8.0f}{numbers[1]:>8.0f}{numbers[2]:>10.0f}')
        loop = subprocess.run(
            [bench, str(asked.seconds)], check=True, capture_output=True, text=True
        )
        print(f'by the clock: {loop.stdout.strip()}')
    print(f'the last one in Python: {in_python(file, asked.rate, 50_000):.1f} us per step')
    return 0


if __name__ == '__main__':
    sys.exit(main())
