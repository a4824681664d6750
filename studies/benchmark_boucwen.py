"""The Bouc-Wen benchmark of nonlinearbenchmark.org: fitted on the training record, scored once.

Run from the root: ``python studies/benchmark_boucwen.py [FOLDER] [--score]``. FOLDER holds
train_multisine.csv, test_multisine.csv and test_sinesweep.csv. Nothing is chosen on the tests.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from piezo_hysteresis.blocks.bouc_wen_oscillator import from_linear
from piezo_hysteresis.identification import FitResult, fit, output_error, targets_of
from piezo_hysteresis.identification.errors import errors_of
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, read_csv

TRUTH = {
    'mass': 2.0,
    'damping': 10.0,
    'stiffness': 5e4,
    'z_alpha': 5e4,
    'z_beta': 800.0,
    'z_gamma': -1100.0,
}
PUBLISHED = 'published, multisine: state-space network 7.5e-6, PNLSS 1.2e-5, dynoNet 4.5e-5 m'


def train(record: Record) -> tuple[FitResult, int, int]:
    """Fit from nine starts around the linear fit; return the best and how many agree with it."""
    targets = targets_of([record])
    linear = output_error(named('linear_mode'), [record], sampling_offset=False)
    model = suited(named('bouc_wen_oscillator'), [record])
    found = from_linear(linear.values)
    reach = float(np.ptp(record.displacement)) / 2
    fits = []
    for share in (0.2, 0.5, 1.0):
        for shape in (-0.9, 0.0, 0.9):
            start = found | {
                'stiffness': (1 - 0.7 * share) * found['stiffness'],
                'z_alpha': share * found['stiffness'],
                'z_beta': 1 / reach,
                'z_gamma': shape / reach,
            }
            fits.append(fit(model, (), start, targets=targets, max_evaluations=60))
    best = min(fits, key=lambda each: each.cost)
    return best, sum(each.cost < 1.001 * best.cost for each in fits), len(fits)


def main() -> None:
    """Train, and score where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', nargs='?', default='../shared/data/boucwen_benchmark', type=Path)
    parser.add_argument('--score', action='store_true', help='look at the two test records')
    arguments = parser.parse_args()
    begun = time.perf_counter()
    best, agree, starts = train(read_csv(arguments.folder / 'train_multisine.csv'))
    print(f'{agree} of {starts} starts agree, {time.perf_counter() - begun:.1f} s')
    print(f'training: {best.rms:.3g} m over the mean period, noise {best.noise:.3g} m per sample')
    for name, true in TRUTH.items():
        value, std = best.values[name], best.std[name]
        print(f'  {name:10} {value:12.6g} +- {std:.2g}  (true {true:g})')
    if not arguments.score:
        return
    multisine = read_csv(arguments.folder / 'test_multisine.csv')
    sweep = read_csv(arguments.folder / 'test_sinesweep.csv')
    for record in (multisine, sweep):
        (row,) = errors_of(best.model, best.values, [record], best.sampling_offset)
        print(f'{record.name}: {row.free_run_rms:.3g} m ({row.nrmse_percent:.3g} %)')
    print(PUBLISHED)


if __name__ == '__main__':
    main()
