"""Time and memory of `identify` on one long record, alone or against another checkout.

Run from the root, with a built checkout of another version to compare with in the same run::

    python bench/long_records.py [--samples 1e6] [--former PATH]

A bank of ten plays is driven by a sine of 5 Hz at 10 kHz, whose amplitude is halved in the middle,
and by a periodic one. Stated are processor time and peak memory of the whole command, report
included, and the largest error of a weight in its standard deviations.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.models import named

RATE, DRIVE, REACH, NOISE = 1e4, 5.0, 50.0, 5e-9
WEIGHTS = 1e-7 * np.array([1.0, 0.3, 0.2, 0.15, 0.12, 0.1, 0.08, 0.06, 0.05, 0.04])
ROOT = Path(__file__).resolve().parents[1]


def weights() -> dict[str, float]:
    """Return the weights of the simulated bank [m/V]."""
    return {f'w{j}': float(w) for j, w in enumerate(WEIGHTS)}


def write_record(path: Path, count: int, *, halved: bool) -> None:
    """Simulate one record and write it as a NumPy file."""
    voltage: FloatArray = REACH * np.sin(2 * np.pi * DRIVE / RATE * np.arange(count))
    if halved:
        voltage[count // 2 :] *= 0.5
    model = named('prandtl_ishlinskii').hold(pi_range=REACH)
    y = model.respond(voltage, model.pack({**weights(), 'offset': 0.0}), 1 / RATE)
    y += NOISE * np.random.default_rng(1).standard_normal(count)
    np.savez(path, voltage_V=voltage, displacement_m=y, dt=1 / RATE)


def identified(record: Path, out: Path, root: Path) -> tuple[float, float, float]:
    """Return processor time [s], peak memory [GB] and the largest error of a weight [std]."""
    command = (
        f'source {root}/setup.bash && exec python -m piezo_hysteresis identify {record} '
        f'--model prandtl_ishlinskii --out {out} --quiet'
    )
    child = os.spawnvp(os.P_NOWAIT, 'bash', ['bash', '-c', f'cd {root} && {command} >/dev/null'])
    _, status, used = os.wait4(child, 0)
    if status:
        raise SystemExit(f'{command}: ended with {status}')
    found = json.loads((out / 'summary.json').read_text())['parameters']
    apart = [
        abs(found[name]['value'] - value) / found[name]['std'] for name, value in weights().items()
    ]
    return used.ru_utime + used.ru_stime, 1e-6 * used.ru_maxrss, max(apart)


def main() -> None:
    """Identify both records with every checkout."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--samples', type=lambda text: int(float(text)), default=1_000_000)
    parser.add_argument('--former', type=Path, help='another built checkout')
    arguments = parsed(parser, samples=20_000)
    roots = {'now': ROOT, **({'former': arguments.former.resolve()} if arguments.former else {})}
    with tempfile.TemporaryDirectory() as folder:
        for kind in ('halved', 'periodic'):
            record = Path(folder) / f'{kind}.npz'
            write_record(record, arguments.samples, halved=kind == 'halved')
            spent = {}
            for name, root in roots.items():
                spent[name], memory, apart = identified(record, Path(folder) / name, root)
                print(
                    f'{kind}, {arguments.samples:.3g} samples, {name}: {spent[name]:.1f} s of '
                    f'processor time, {memory:.2f} GB, worst weight {apart:.1f} std off'
                )
            if 'former' in spent:
                print(f'  {spent["former"] / spent["now"]:.1f} times as fast as the former one')


if __name__ == '__main__':
    main()
