"""PySINDy: its STLSQ over a library that holds the effects' own equations.

As favourable as we could make it: SINDy knows no names, so the discrepancy of the fitted baseline
is the target (Ebers, Steele, Kutz 2024) and every column of the library is an effect of the list,
computed by its equation, the tangent of the baseline taken out. The threshold is the one with the
least BIC. A surviving column gives its name; nothing surviving, or less than 5 % explained, is
`none`, less than 30 % is `unknown`. PySINDy states no probabilities: they are calibrated as those
of every entry (`calibrated`).
"""

from __future__ import annotations

import warnings

import numpy as np

from piezo_benchmark.entries.calibrated import Statement, answered
from piezo_benchmark.entries.common import library, memory
from piezo_benchmark.tasks import Answer, Task
from piezo_benchmark.worlds import Array

THRESHOLDS = (0.9, 0.6, 0.4, 0.25, 0.15, 0.1, 0.06, 0.04)


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('pysindy', task, statement(task))


def statement(task: Task) -> Statement:
    """Return the names of the surviving columns."""
    from pysindy import STLSQ

    lib = library(task)
    effective = lib.target.size * memory(lib.fit.residual)
    best: tuple[float, Array] = (
        effective * np.log(np.mean(lib.target**2)),
        np.zeros(len(lib.parts)),
    )
    for threshold in THRESHOLDS:
        optimizer = STLSQ(threshold=threshold, alpha=1e-4, max_iter=20)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            optimizer.fit(lib.columns, lib.target[:, None])
        weights = np.asarray(optimizer.coef_).ravel()
        left = float(np.mean((lib.target - lib.columns @ weights) ** 2))
        score = effective * np.log(left) + np.count_nonzero(weights) * np.log(effective)
        if score < best[0]:
            best = score, weights
    return lib.statement(best[1])
