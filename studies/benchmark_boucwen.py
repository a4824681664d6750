"""The Bouc-Wen benchmark of nonlinearbenchmark.org: fitted on the training record, scored once.

Run from the root: ``python studies/benchmark_boucwen.py [FOLDER] [--score]``. FOLDER holds
train_multisine.csv, test_multisine.csv and test_sinesweep.csv. Nothing is chosen on the tests.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import product
from math import inf
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.blocks.bouc_wen_oscillator import from_linear
from piezo_hysteresis.identification import FitResult, fit, output_error, targets_of
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.identification.simulate import Unsaved, free_runs
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, read_csv
from studies.worlds.stand_ins import records_in

TRUTH = {
    'mass': 2.0,
    'damping': 10.0,
    'stiffness': 5e4,
    'z_alpha': 5e4,
    'z_beta': 800.0,
    'z_gamma': -1100.0,
}
FILES = ('train_multisine.csv', 'test_multisine.csv', 'test_sinesweep.csv')
PUBLISHED = (
    'published for black boxes, which do not know the structure as this fit does, multisine: '
    'state-space network 7.5e-6, PNLSS 1.2e-5, dynoNet 4.5e-5 m'
)


def train(record: Record, starts: int, evaluations: int) -> tuple[FitResult, int, int]:
    """Fit from up to nine starts around the linear fit; return the best and how many agree."""
    targets = targets_of([record])
    linear = output_error(named('linear_mode'), [record], sampling_offset=False)
    model = suited(named('bouc_wen_oscillator'), [record])
    found = from_linear(linear.values)
    reach = float(np.ptp(record.displacement)) / 2
    fits = []
    for share, shape in list(product((0.2, 0.5, 1.0), (-0.9, 0.0, 0.9)))[:starts]:
        start = found | {
            'stiffness': (1 - 0.7 * share) * found['stiffness'],
            'z_alpha': share * found['stiffness'],
            'z_beta': 1 / reach,
            'z_gamma': shape / reach,
        }
        fits.append(fit(model, (), start, targets=targets, max_evaluations=evaluations))
    best = min(fits, key=lambda each: each.cost)
    return best, sum(each.cost < 1.001 * best.cost for each in fits), len(fits)


def main() -> None:
    """Train, and score where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', nargs='?', default='../shared/data/boucwen_benchmark', type=Path)
    parser.add_argument('--score', action='store_true', help='look at the two test records')
    parser.add_argument('--starts', type=int, default=9, help='of the fit')
    parser.add_argument('--evaluations', type=int, default=60, help='of each start, at most')
    arguments = parsed(parser, folder=None, score=True, starts=1, evaluations=4)
    with records_in(arguments.folder, FILES, seconds=0.4) as folder:
        measure(folder, arguments)


def measure(folder: Path, arguments: argparse.Namespace) -> None:
    """Train on one record, and score on two where that is asked for."""
    training, multisine, sweep = (folder / file for file in FILES)
    started = time.perf_counter()
    record = read_csv(training)
    best, agree, starts = train(record, arguments.starts, arguments.evaluations)
    print(f'{agree} of {starts} starts agree, {time.perf_counter() - started:.1f} s')
    print(f'training: {best.rms:.3g} m over the mean period, noise {best.noise:.3g} m per sample')
    for name, true in TRUTH.items():
        value, std = best.values[name], best.std[name]
        print(f'  {name:10} {value:12.6g} +- {std:.2g}  (true {true:g})')
    if not arguments.score:
        return
    for record in (read_csv(multisine), read_csv(sweep)):
        (row,) = free_runs(
            Unsaved(best.model, best.values, best.sampling_offset, inf), [record]
        ).errors
        print(f'{record.name}: {row.free_run_rms:.3g} m ({row.nrmse_percent:.3g} %)')
    print(PUBLISHED)


if __name__ == '__main__':
    main()
