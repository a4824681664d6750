"""Knows the actuator, its discrepancy and the exact signature of what hides: an upper limit.

It does not know which hypothesis is true. The likelihood ratio compares the true signature s with
every rival of the list in the noise as it was, `r = a s + J d + n`: a = 1 for the truth, a free
amplitude for each rival (two for a pair), the tangent J of the baseline free, each record's zero
free. Hypotheses have the published frequencies as prior. The limit is one to first order: rivals
are columns from a grid of parameters. Its prediction is as wrong as the control.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from piezo_benchmark.entries import most_frequent
from piezo_benchmark.entries.common import basis, memory, signatures
from piezo_benchmark.fits import NAMES, Fit, centred, linearised
from piezo_benchmark.scores import distribution
from piezo_benchmark.tasks import NONE, Answer, Task, Truth
from piezo_benchmark.worlds import Array

NEEDS_TRUTH = True


def answer(task: Task, truth: Truth) -> Answer:
    """Return the posterior of the likelihood ratio."""
    keys = [('', name) for name in NAMES[task.baseline.name]]
    _, slopes, _ = linearised(
        task.baseline.name, task.records.voltage, task.scale, truth.values, {}, keys
    )
    q = basis(np.array([centred(slope, task.warm_up).ravel() for slope in slopes]).T)

    def free(column: Array) -> Array:
        return np.asarray(column - q @ (q.T @ column))

    hidden, rest = (centred(x, task.warm_up) for x in (truth.discrepancy, truth.rest))
    r, s = free((hidden + rest).ravel()), free(hidden.ravel())
    near = Fit(dict(truth.values), {}, {}, hidden + rest, q)
    columns: dict[str, list[Array]] = {}
    for signature in signatures(replace(task, reference=None), near):
        column = free(signature.training.ravel())
        size = float(np.sqrt(column @ column))
        if size > 1e-20:
            columns.setdefault(signature.name, []).append(column / size)
    best = {name: max(found, key=lambda c: abs(float(c @ r))) for name, found in columns.items()}
    if 'tone' in columns:  # sine and cosine of the strongest one
        best['tone'] = columns['tone'][0]
    scores = {NONE: float(r @ r)} | {name: _left(r, [c]) for name, c in best.items()}
    for pair in combinations(best, 2):
        scores['+'.join(sorted(pair))] = _left(r, [best[name] for name in pair])
    effective = r.size * memory(rest)
    variance = float(np.mean(rest**2))
    tries = {name: len(found) for name, found in columns.items()} | {'tone': r.shape[0] // 8}
    costs = {
        name: effective * left / (r.size * variance)
        + sum(np.log(effective) + 2.0 * np.log(tries[n]) for n in name.split('+') if n in tries)
        for name, left in scores.items()
    }
    costs[truth.outcome] = effective * float((r - s) @ (r - s)) / (r.size * variance)
    prior = distribution(most_frequent.answer(task))
    weights = {
        name: float(np.exp(-0.5 * (cost - min(costs.values()))) * prior[name])
        for name, cost in costs.items()
    }
    total = sum(weights.values())
    return Answer(
        {name: w / total for name, w in weights.items()}, prediction=_control(task, truth)
    )


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
