"""Scores: proper ones of probabilities, false alarms, held-out error, calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from piezo_benchmark.fits import centred
from piezo_benchmark.tasks import NONE, UNKNOWN, Answer, Task, Truth, outcomes
from piezo_benchmark.worlds import Array

#: Share of every answer that is spread over all outcomes: no single answer costs all.
FLOOR = 0.01
GROUPS = ('clean', 'conditions', 'foreign', 'measured', 'pair', 'nothing', 'outside')
BINS = (0.0, 0.3, 0.5, 0.7, 0.9, 1.0)


def distribution(answer: Answer) -> dict[str, float]:
    """Return a probability of every outcome.

    A class gives each of its members an equal part. The rest to 1 is spread over all
    outcomes, more than 1 is scaled down, and `FLOOR` of it all is spread as well.

    Raises
    ------
    ValueError
        For an outcome that is not one, and for a probability that is negative or no number.
    """
    found = dict.fromkeys(outcomes(), 0.0)
    parts: list[tuple[tuple[str, ...], float]] = [
        ((name,), p) for name, p in answer.probabilities.items()
    ]
    parts += [(tuple(names), p) for names, p in answer.classes]
    for names, p in parts:
        if not (np.isfinite(p) and p >= 0.0):
            raise ValueError(f'{p} is no probability')
        for name in names:
            key = '+'.join(sorted(name.split('+')))
            if key not in found:
                raise ValueError(f'{name} is no outcome; they are names of the list, two of '
                                 f'them joined by +, {NONE} and {UNKNOWN}')  # fmt: skip
            found[key] += p / len(names)
    total, count = sum(found.values()), len(found)
    left = max(1.0 - total, 0.0) / count
    over = max(total, 1.0)
    return {k: (1 - FLOOR) * (p / over + left) + FLOOR / count for k, p in found.items()}


def held_out_error(prediction: Array, task: Task, truth: Truth) -> float:
    """Return the rms error [m] on held-out records after the warm-up, the zero of each free."""
    missed = centred(np.asarray(prediction) - truth.held_out, task.warm_up)
    return float(np.sqrt(np.mean(missed**2)))


@dataclass(frozen=True)
class Row:
    """One answer with its truth.

    Attributes
    ----------
    bits : float
        Log score: minus the binary logarithm of the probability of the truth.
    top, confidence : str, float
        The most probable outcome and its probability.
    right, false_alarm : float
        Whether that is the truth; whether it holds a name that is not there. Of outcomes that
        are equally probable the mean.
    class_size, in_class : int, bool
        Of the smallest class that holds 90 % of the probability.
    ratio : float
        Held-out error over the control's own.
    parameter_error : float or None
        Largest relative error of the parameters of effects that are rightly named.
    covered : float or None
        Share of these parameters within two of their standard deviations.
    """

    identifier: str
    group: str
    truth: str
    bits: float
    top: str
    confidence: float
    right: float
    false_alarm: float
    class_size: int
    in_class: bool
    ratio: float
    parameter_error: float | None
    covered: float | None
    seconds: float
    failed: str = ''


def scored(task: Task, truth: Truth, answer: Answer, seconds: float, failed: str = '') -> Row:
    """Score one answer."""
    p = distribution(answer)
    top = max(p, key=lambda name: p[name])
    tops = [name for name in p if p[name] > p[top] - 1e-12]
    false = [bool(set(t.split('+')) - {NONE, UNKNOWN} - set(truth.names)) for t in tops]
    ordered = sorted(p, key=lambda name: -p[name])
    size = int(np.searchsorted(np.cumsum([p[name] for name in ordered]), 0.9) + 1)
    prediction = task.held_out.free_run if answer.prediction is None else answer.prediction
    error = held_out_error(prediction, task, truth)
    worst, covered = _parameters(truth, answer)
    return Row(
        task.identifier, truth.group, truth.outcome, float(-np.log2(p[truth.outcome])), top,
        p[top], (truth.outcome in tops) / len(tops), sum(false) / len(tops), size,
        truth.outcome in ordered[:size],
        error / truth.control if np.isfinite(error) else np.inf, worst, covered, seconds, failed,
    )  # fmt: skip


def _parameters(truth: Truth, answer: Answer) -> tuple[float | None, float | None]:
    errors, inside = [], []
    for name, said in answer.parameters.items():
        for parameter, (value, deviation) in said.items():
            true = truth.parameters.get(name, {}).get(parameter)
            if truth.kind in ('single', 'pair') and true:
                errors.append(abs(value / true - 1.0))
                inside.append(abs(value - true) <= 2.0 * deviation)
    return (max(errors), float(np.mean(inside))) if errors else (None, None)


# --- over many ----------------------------------------------------------------------------------


def interval(
    numbers: Sequence[float], statistic: Callable[[Array], float], seed: int = 0
) -> tuple[float, float, float]:
    """Return a statistic and its 95 % interval by 1000 resamples of the tasks."""
    x = np.asarray(numbers, dtype=np.float64)
    random = np.random.default_rng(seed)
    drawn = [statistic(x[random.integers(0, x.size, x.size)]) for _ in range(1000)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return statistic(x), float(low), float(high)


def _mean(x: Array) -> float:
    return float(np.mean(x))


def _geometric(x: Array) -> float:
    return float(np.exp(np.mean(np.log(np.clip(x, 1e-3, 1e3)))))


def summary(rows: Sequence[Row]) -> dict[str, dict[str, object]]:
    """Return the numbers of each group; there is no total over groups."""
    found: dict[str, dict[str, object]] = {}
    for group in GROUPS:
        part = [row for row in rows if row.group == group]
        if not part:
            continue
        known = [row.parameter_error for row in part if row.parameter_error is not None]
        inside = [row.covered for row in part if row.covered is not None]
        found[group] = {
            'tasks': len(part),
            'bits': interval([r.bits for r in part], _mean),
            'right': interval([r.right for r in part], _mean),
            'false_alarms': interval([r.false_alarm for r in part], _mean),
            'in_class': _mean(np.array([float(r.in_class) for r in part])),
            'class_size': _mean(np.array([float(r.class_size) for r in part])),
            'ratio': interval([r.ratio for r in part], _geometric),
            'parameter_error': float(np.median(known)) if known else None,
            'covered': _mean(np.array(inside)) if inside else None,
            'seconds': float(np.median([r.seconds for r in part])),
            'longest': max(r.seconds for r in part),
            'failed': sum(bool(r.failed) for r in part),
        }
    return found


def calibration(rows: Sequence[Row]) -> list[dict[str, float]]:
    """Return how often the most probable outcome was right, in bins of its probability."""
    found = []
    for low, high in pairwise(BINS):
        part = [r for r in rows if low < r.confidence <= high]
        if part:
            said = _mean(np.array([r.confidence for r in part]))
            right = _mean(np.array([r.right for r in part]))
            found.append({'low': low, 'high': high, 'tasks': len(part), 'said': said,
                          'right': right})  # fmt: skip
    return found
