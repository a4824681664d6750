"""freq-statespace on the measured mirror, in the settings of its authors' notebook.

In an environment of its own (requirements_jax.txt)::

    python studies/peers/mirror.py FOLDER TURNS SECONDS

The records of `study.py mirror`: realisation 5 of each amplitude is held out, the other 15 are
fitted together. TURNS of inference and learning (about 8 s of processor time each), then all
parameters until SECONDS of processor time have passed; each model is evaluated.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

import freq_statespace as fss
import numpy as np
import optimistix as optx

RATE, HIGHEST, STATES, DEGREE, INTO, OUT = 6400.0, 3000.0, 28, 7, 12, 6
LEVELS = ('100mV', '200mV', '300mV')


def realisations(folder: Path, kind: str) -> list[Any]:
    """Return the arrays (sample, channel, realisation, period) of each amplitude."""
    return [np.load(next(folder.glob(f'{kind}_*{level}*.npy'))) for level in LEVELS]


def errors(model: Any, u: list[Any], y: list[Any]) -> str:
    """Return the metric of the benchmark on the held-out realisations [um]."""
    found = []
    for driven, moved in zip(u, y, strict=True):
        run = model.simulate(driven[:, :, -1:], offset=1000)[0]
        error = 1e6 * (moved[:, :, -1:] - np.asarray(run).reshape(moved[:, :, -1:].shape))
        found.append(np.mean(np.sqrt(np.mean(error**2, 0))))
    return ' / '.join(f'{each:.4f}' for each in found) + ' um'


def one_record(model: Any, driven: Any) -> float:
    """Return the median time that the simulation of one record takes, once compiled [s]."""
    taken = []
    for _ in range(20):
        started = time.perf_counter()
        np.asarray(model.simulate(driven[:, :, :1], offset=1000)[0])
        taken.append(time.perf_counter() - started)
    return float(np.median(taken[1:]))


def main(folder: Path, turns: int, seconds: float) -> None:
    """Fit the linear model, then the nonlinear one until the time is over."""
    u, y = realisations(folder, 'u'), realisations(folder, 'y')
    started = time.process_time()

    def state(words: str, model: Any) -> None:
        passed = time.process_time() - started
        one = 1e3 * one_record(model, u[-1])
        print(
            f'{words}: {errors(model, u, y)}, {passed:.0f} s, one record {one:.1f} ms', flush=True
        )

    inputs, outputs = (np.concatenate([each[:, :, :-1] for each in those], 2) for those in (u, y))
    lines = np.arange(1, math.ceil(HIGHEST / (RATE / inputs.shape[0])))
    data = fss.create_data_object(inputs, outputs, lines, RATE)
    plain: dict[str, Any] = {'freq_weighting': False}
    linear = fss.lin.subspace_id(data, STATES, **plain)
    linear = fss.lin.optimize(
        linear, data, solver=optx.BFGS(rtol=1e-3, atol=1e-5), print_every=100, **plain
    )
    state('linear', linear)
    basis = fss.static.basis.Polynomial(INTO, DEGREE, cross_terms=False)
    more = {'solver': optx.BFGS(rtol=1e-3, atol=1e-6), 'print_every': 10, **plain}
    model = fss.nonlin.inference_and_learning(linear, data, basis, OUT, max_iter=turns, **more)
    state('inference and learning', model)
    while time.process_time() - started < seconds:
        model = fss.nonlin.optimize(model, data, max_iter=100, **more)
        state('all parameters', model)


if __name__ == '__main__':
    main(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
