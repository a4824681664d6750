"""Joint fit without names: all baseline parameters, a delay and a lag in one least squares.

This is what mujoco.sysid and similar tools do: gain, bias and delay of the measurement are
parameters, several records one fit. It names nothing, so its answer is `unknown` by half and
nothing else in particular.
"""

from __future__ import annotations

from piezo_benchmark.entries.common import (
    all_measured,
    base_fit,
    held_out_run,
    voltage_before,
)
from piezo_benchmark.fits import fitted
from piezo_benchmark.tasks import UNKNOWN, Answer, Task


def answer(task: Task) -> Answer:
    """Return a prediction and no name."""
    base, dt = base_fit(task), task.scale.dt
    extra = {'transport_delay': {'delay': 1.5 * dt}, 'amplifier_lag': {'lag_time': 0.5 * dt}}
    fit = fitted(
        task.baseline.name, task.records.voltage, all_measured(task), task.scale, task.warm_up,
        base.values, extra, before=voltage_before(task),
    )  # fmt: skip
    best = fit if fit.rss < base.rss else base
    prediction = held_out_run(task, best.values, best.effects)
    return Answer({UNKNOWN: 0.5}, prediction=prediction)
