"""Our least squares against SciPy's on one problem: same simulations, same exact derivatives.

The free run of a chain with a hysteresis and a mode is fitted to six sines of 34 000 samples each,
from starts drawn around the truth. Both solvers get the same residuals, Jacobian and bounds; what
differs is that ours sees the data through the triangular factor alone, which it forms record by
record without the matrix, and what each does with it.

    python bench/solver.py [--starts 12] [--samples 34000]
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification import targets_of
from piezo_hysteresis.identification.objective import Objective
from piezo_hysteresis.identification.solver import solve
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, RecordInfo

DT = 1e-3
NOISE = 20e-9
FREQUENCIES = (1, 7, 14, 23, 35, 50)
CLOSE = 1.001  # cost over that of the truth at which a fit has arrived


def problem(samples: int) -> tuple[Model, dict[str, float], Objective]:
    """Return a model, its true values, and the fit to what it answers with noise."""
    model = named('bouc_wen_mode')
    truth = {**model.defaults(), 'beta': 2.5, 'gamma': 1.0, 'natural_frequency': 61.0,
             'damping_ratio': 0.02, 'offset': 6e-6}  # fmt: skip
    records = []
    for f in FREQUENCIES:
        u = np.sin(2 * np.pi * f * DT * np.arange(samples))
        y = model.respond(u, model.pack(truth), DT)
        y += NOISE * np.random.default_rng(f).normal(size=u.size)
        records.append(Record(f'{f} Hz', DT, u, y, info=RecordInfo(frequency=float(f))))
    targets = targets_of(records, folded=False, start='rest')
    return model, truth, Objective(model, targets, model.free_names, truth)


def starts(model: Model, truth: dict[str, float], count: int) -> list[FloatArray]:
    """Return points within a factor of 2 of the truth (what is zero or a frequency: 10 %)."""
    rng = np.random.default_rng(1)
    middle = np.array([truth[name] for name in model.free_names])
    spread = np.array(
        [0.1 if name == 'natural_frequency' else np.log(2) for name in model.free_names]
    )
    return [middle * np.exp(spread * rng.uniform(-1, 1, middle.size)) for _ in range(count)]


def ours(
    objective: Objective, start: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[float, int]:
    """Return the cost and the simulations of our solver."""
    found = solve(objective, start, low, high)
    return found.cost, found.evaluations


def scipys(
    objective: Objective, start: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[float, int]:
    """Return the cost and the simulations of SciPy's trust region with bounds."""
    from scipy.optimize import least_squares

    def residuals(x: FloatArray) -> FloatArray:
        return np.asarray(1e6 * np.concatenate(objective.residuals(x)))

    def jacobian(x: FloatArray) -> FloatArray:
        # residuals are measured minus simulated
        return np.asarray(
            -1e6 * np.hstack([objective.jacobian(t, x)[1] for t in objective.targets]).T
        )

    found: Any = least_squares(
        residuals, start, jac=jacobian, bounds=(low, high), x_scale='jac', ftol=1e-9, max_nfev=100
    )
    return 1e-12 * float(found.cost), int(found.nfev + found.njev)


def measured(run: Callable[[], tuple[float, int]]) -> tuple[float, float, int, float]:
    """Return processor time [s], cost, simulations and peak memory [byte] of a fit."""
    started = time.process_time()
    cost, used = run()
    took = time.process_time() - started
    tracemalloc.start()
    run()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return took, cost, used, peak


def main() -> int:
    """Run the comparison; exit code 1 if ours arrives less often."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--starts', type=int, default=12)
    parser.add_argument('--samples', type=int, default=34_000, help='of each record')
    options = parsed(parser, starts=2, samples=2000)
    model, truth, objective = problem(options.samples)
    limits = {each.name: (each.low, each.high) for each in model.parameters}
    low, high = np.array([limits[name] for name in model.free_names]).T
    floor = objective.cost(np.array([truth[name] for name in model.free_names]))
    points = starts(model, truth, options.starts)
    ours(objective, points[0], low, high)  # compiles
    print(f'{len(FREQUENCIES) * options.samples} samples, {low.size} parameters')
    print('solver   arrived   cpu s a fit   simulations   peak MB')
    arrived = []
    for name, solver in (('ours', ours), ('scipy', scipys)):
        rows = [measured(lambda p=p, s=solver: s(objective, p, low, high)) for p in points]  # type: ignore[misc]
        took, cost, used, peak = (np.array(column) for column in zip(*rows, strict=True))
        arrived.append(int(np.sum(cost <= CLOSE * floor)))
        print(
            f'{name:6} {arrived[-1]:4d} of {len(points)} {took.mean():11.2f} {used.mean():13.1f} '
            f'{peak.max() / 1e6:9.0f}',
            flush=True,
        )
    return 0 if options.quick or arrived[0] >= arrived[1] else 1


if __name__ == '__main__':
    sys.exit(main())
