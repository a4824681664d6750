"""Joint fit without names: all baseline parameters, a delay and a lag in one least squares.

This is what mujoco.sysid and similar tools do: gain, bias and delay of the measurement are
parameters, several records one fit. It names nothing. Whether delay and lag lower BIC, and whether
a residual remains, give calibrated frequencies of `none`, `unknown` and the names (`calibrated`).
"""

from __future__ import annotations

import numpy as np

from piezo_benchmark.entries.calibrated import Statement, answered, kind_of
from piezo_benchmark.entries.common import (
    all_measured,
    base_fit,
    corrected,
    held_out_run,
    memory,
    remains,
    voltage_before,
)
from piezo_benchmark.fits import fitted
from piezo_benchmark.tasks import NONE, UNKNOWN, Answer, Task


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('joint_fit', task, statement(task))


def statement(task: Task) -> Statement:
    """Return a prediction, and delay and lag as possible names where they lower BIC."""
    known = corrected(task)
    task = known.task
    base, dt = base_fit(task), task.scale.dt
    extra = {'transport_delay': {'delay': 1.5 * dt}, 'amplifier_lag': {'lag_time': 0.5 * dt}}
    fit = fitted(
        task.baseline.name, task.records.voltage, all_measured(task), task.scale, task.warm_up,
        base.values, extra, before=voltage_before(task),
    )  # fmt: skip
    samples = base.residual.size * memory(base.residual)
    better = samples * np.log(base.rss / fit.rss) > len(extra) * np.log(samples)
    best = fit if better else base
    left = remains(best.residual)
    word = UNKNOWN if left or better else NONE
    return Statement(
        ('late' if better else 'in time', *kind_of(word, left, task)[1:]),
        {word: 1.0},
        dict.fromkeys(extra, 1.0) if better else {},
        held_out_run(task, best.values, best.effects) + known.held_out,
    )
