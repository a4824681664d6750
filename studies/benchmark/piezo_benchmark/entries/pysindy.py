"""PySINDy: its STLSQ over a library that holds the effects' own equations.

As favourable as we could make it: SINDy knows no names, so the discrepancy of the fitted baseline
is the target (Ebers, Steele, Kutz 2024) and every column of the library is an effect of the list,
computed by its equation, the tangent of the baseline taken out. The threshold is the one with the
least BIC. A surviving column gives its name; nothing surviving, or less than 5 % explained, is
`none`, less than 30 % is `unknown`. Its authors' way to probabilities is an ensemble (Fasel, Kutz,
Brunton, Brunton 2022): the outcomes of models of resampled data by their frequency. Blocks of
samples are drawn, because neighbouring residuals are correlated. The frequencies are calibrated as
those of every entry (`calibrated`).
"""

from __future__ import annotations

import warnings

import numpy as np

from piezo_benchmark.entries.calibrated import Statement, answered
from piezo_benchmark.entries.common import library, memory
from piezo_benchmark.tasks import Answer, Task
from piezo_benchmark.worlds import Array

THRESHOLDS = (0.9, 0.6, 0.4, 0.25, 0.15, 0.1, 0.06, 0.04)
MODELS, BLOCK = 10, 50  # of the ensemble; samples


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('pysindy', task, statement(task))


def statement(task: Task) -> Statement:
    """Return the names of the surviving columns, by the outcomes of an ensemble."""
    lib = library(task)
    effective = lib.target.size * memory(lib.fit.residual)
    best = effective * np.log(np.mean(lib.target**2)), 0.0, np.zeros(len(lib.parts))
    for threshold in THRESHOLDS:
        weights = sparse(lib.columns, lib.target, threshold)
        left = float(np.mean((lib.target - lib.columns @ weights) ** 2))
        score = effective * np.log(left) + np.count_nonzero(weights) * np.log(effective)
        if score < best[0]:
            best = score, threshold, weights
    _, threshold, weights = best
    if not threshold:
        return lib.statement(weights)
    rng = np.random.default_rng(0)
    first = rng.integers(0, lib.target.size - BLOCK, (MODELS, lib.target.size // BLOCK, 1))
    drawn = (first + np.arange(BLOCK)).reshape(MODELS, -1)
    models = [sparse(lib.columns[at], lib.target[at], threshold) for at in drawn]
    return lib.statement(weights, models)


def sparse(columns: Array, target: Array, threshold: float) -> Array:
    """Return the weights of columns by STLSQ."""
    from pysindy import STLSQ

    optimizer = STLSQ(threshold=threshold, alpha=1e-4, max_iter=20)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        optimizer.fit(columns, target[:, None])
    return np.asarray(optimizer.coef_).ravel()
