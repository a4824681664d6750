"""Knows the actuator, its discrepancy and the exact signature of what hides: an upper limit.

It does not know which hypothesis is true. The likelihood ratio compares the true signature s with
every rival of the list in the noise as it was, `r = a s + J d + n`: a = 1 for the truth, a free
amplitude for each rival (two for a pair), the tangent J of the baseline free, each record's zero
free. Noise is whitened by an autoregression on the true noise of each record. Hypotheses have the
published frequencies as prior. The limit is one to first order: rivals are columns from a grid of
parameters. Its prediction has the error of the control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from piezo_benchmark.entries import most_frequent
from piezo_benchmark.entries.common import basis, signatures
from piezo_benchmark.fits import NAMES, Fit, centred, linearised
from piezo_benchmark.scores import distribution
from piezo_benchmark.tasks import NONE, Answer, Task, Truth
from piezo_benchmark.worlds import Array

NEEDS_TRUTH = True
ORDER = 10  # of the autoregression of the noise


def answer(task: Task, truth: Truth) -> Answer:
    """Return the posterior of the likelihood ratio."""
    keys = [('', name) for name in NAMES[task.baseline.name]]
    _, slopes, _ = linearised(
        task.baseline.name, task.records.voltage, task.scale, truth.values, {}, keys
    )
    hidden, rest = (centred(x, task.warm_up) for x in (truth.discrepancy, truth.rest))
    white = whitening(rest)
    q = basis(np.array([white(centred(slope, task.warm_up)) for slope in slopes]).T)

    def free(signal: Array) -> Array:
        column = white(signal)
        return np.asarray(column - q @ (q.T @ column))

    r, s = free(hidden + rest), free(hidden)
    near = Fit(dict(truth.values), {}, {}, hidden + rest, q)
    columns: dict[str, list[Array]] = {}
    for signature in signatures(replace(task, reference=None), near):
        column = free(signature.training)
        size = float(np.sqrt(column @ column))
        if size > 1e-9:
            columns.setdefault(signature.name, []).append(column / size)
    best = {name: max(found, key=lambda c: abs(float(c @ r))) for name, found in columns.items()}
    if 'tone' in columns:  # sine and cosine of the strongest one
        best['tone'] = columns['tone'][0]
    costs = {NONE: float(r @ r)} | {name: _left(r, [c]) for name, c in best.items()}
    for pair in combinations(best, 2):
        costs['+'.join(sorted(pair))] = _left(r, [best[name] for name in pair])
    tries = {name: len(found) for name, found in columns.items()} | {'tone': r.size // 8}
    for name in costs:
        costs[name] += sum(
            np.log(r.size) + 2.0 * np.log(tries[n]) for n in name.split('+') if n in tries
        )
    costs[truth.outcome] = float((r - s) @ (r - s))
    prior = distribution(most_frequent.answer(task))
    weights = {
        name: float(np.exp(-0.5 * (cost - min(costs.values()))) * prior[name])
        for name, cost in costs.items()
    }
    total = sum(weights.values())
    return Answer(
        {name: w / total for name, w in weights.items()}, prediction=_control(task, truth)
    )


def whitening(noise: Array) -> Callable[[Array], Array]:
    """Return a filter that makes noise (samples, records) white with variance 1, as a vector."""
    filters, sizes = [], []
    for x in noise.T:
        past = np.array([x[ORDER - k : x.size - k] for k in range(1, ORDER + 1)]).T
        weights = np.linalg.lstsq(past, x[ORDER:], rcond=None)[0]
        filters.append(np.concatenate([[1.0], -weights]))
        sizes.append(np.std(x[ORDER:] - past @ weights))

    def white(signal: Array) -> Array:
        found = [
            np.convolve(x, own, 'valid') / size
            for x, own, size in zip(signal.T, filters, sizes, strict=True)
        ]
        return np.concatenate([x - x.mean() for x in found])

    return white


def _left(r: Array, columns: list[Array]) -> float:
    matrix = np.array(columns).T
    fit, *_ = np.linalg.lstsq(matrix, r, rcond=1e-8)
    return float(np.sum((r - matrix @ fit) ** 2))


def _control(task: Task, truth: Truth) -> Array:
    """Return a prediction that is wrong by the control's error, in a cosine."""
    count, records = truth.held_out.shape
    wave = np.cos(2 * np.pi * 40 * np.arange(count) / (count - task.warm_up))[:, None]
    kept = centred(wave * np.ones(records), task.warm_up)
    return np.asarray(truth.held_out + truth.control * wave / np.sqrt(np.mean(kept**2)))
