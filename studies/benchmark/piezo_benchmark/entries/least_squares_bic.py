"""Free least squares over the same list, in free run with the baseline, compared by BIC.

Every effect is screened next to the tangent of the baseline; the five best are fitted with all
parameters free, and two more with the best of them. The sample size in the criterion is
reduced by the correlation of neighbouring residuals, and each name costs the logarithm of the
number of candidates (extended BIC, Chen and Chen 2008). Reference records are fitted along,
without effects; the error that the baseline has on them is subtracted, and what is uncertain of it
counts as noise (`common.corrected`). The posterior is calibrated as the answers of every entry
(`calibrated`).
"""

from __future__ import annotations

import numpy as np

from piezo_benchmark.effects import EFFECTS, scaled
from piezo_benchmark.entries import common
from piezo_benchmark.entries.calibrated import Statement, answered, kind_of
from piezo_benchmark.entries.common import (
    all_measured,
    base_fit,
    basis,
    free_names,
    held_out_run,
    signatures,
    voltage_before,
)
from piezo_benchmark.fits import Fit, fitted
from piezo_benchmark.tasks import NONE, Answer, Task

FITTED, FITTED_BESIDE = 5, 3
TEMPERED = 40.0  # in BIC: how much worse a candidate may be and still be possible


def screened(task: Task, fit: Fit) -> list[tuple[float, str, dict[str, float]]]:
    """Return for every effect the best start: residual, name, parameters; best first."""
    q = basis(fit.jacobian)
    r = fit.residual.ravel()
    r = r - q @ (q.T @ r)
    best: dict[str, tuple[float, str, dict[str, float]]] = {}
    for s in signatures(task, fit):
        column = s.training.ravel()
        column = column - q @ (q.T @ column)
        size = float(column @ column)
        if size < 1e-30:
            continue
        factor = float(column @ r) / size
        left = float(r @ r) - factor**2 * size
        if s.name in ('transport_delay', 'amplifier_lag', 'saturation', 'friction'):
            factor = float(np.clip(factor, 0.1, 3.0))
        parameters = scaled(s.name, s.parameters, float(np.clip(factor, -20.0, 20.0)))
        if s.name == 'tone':  # both columns of a tone are free in the fit
            parameters = {k: v if v else 1e-4 for k, v in parameters.items()}
        if s.name not in best or left < best[s.name][0]:
            best[s.name] = left, s.name, parameters
    return sorted(best.values(), key=lambda item: item[0])


def refined(task: Task, fit: Fit, name: str, parameters: dict[str, float]) -> Fit:
    """Fit one effect more, everything free."""
    return fitted(
        task.baseline.name, task.records.voltage, all_measured(task), task.scale, task.warm_up,
        fit.values, {**fit.effects, name: parameters}, before=voltage_before(task),
    )  # fmt: skip


def candidates(task: Task) -> dict[str, Fit | float]:
    """Return outcome to fit, or to its sum of squares where it was only screened."""
    base = base_fit(task)
    found: dict[str, Fit | float] = {NONE: base}
    for place, (left, name, parameters) in enumerate(screened(task, base)):
        found[name] = refined(task, base, name, parameters) if place < FITTED else left
    singles = [f for f in found.values() if isinstance(f, Fit) and f.effects]
    if singles:
        best = min(singles, key=lambda f: f.rss)
        for _, name, parameters in screened(task, best)[:FITTED_BESIDE]:
            pair = refined(task, best, name, parameters)
            found['+'.join(sorted(pair.effects))] = pair
    return found


def _tries(task: Task, name: str) -> float:
    """Return among how many candidates a name was chosen: effects, and frequencies of a tone."""
    return len(EFFECTS) * (task.records.voltage.shape[0] / 8 if name == 'tone' else 1.0)


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('least_squares_bic', task, statement(task))


def statement(task: Task) -> Statement:
    """Return the posterior of BIC, and prediction and parameters of the best."""
    known = common.corrected(task)
    task = known.task
    found = candidates(task)
    fits = {name: f for name, f in found.items() if isinstance(f, Fit)}
    sharpest = min(fits.values(), key=lambda f: f.rss)
    samples = sharpest.residual.size
    effective = samples * common.memory(sharpest.residual)
    scores = {}
    for name, fit in found.items():
        rss = fit.rss if isinstance(fit, Fit) else fit
        extra = sum(len(e) for e in fit.effects.values()) if isinstance(fit, Fit) else 1
        count = free_names(task) + extra
        scores[name] = effective * np.log(rss / samples + known.error**2) + count * np.log(
            effective
        )
        scores[name] += sum(2.0 * np.log(_tries(task, n)) for n in name.split('+') if n != NONE)
    least = min(scores.values())
    best = min(fits, key=lambda name: scores[name])
    chosen = fits[best]
    parameters = {
        effect: {name: (value, chosen.deviations[effect, name]) for name, value in e.items()}
        for effect, e in chosen.effects.items()
    }
    return Statement(
        kind_of(best, common.remains(chosen.residual), task),
        {name: float(np.exp(-0.5 * (score - least))) for name, score in scores.items()},
        {name: float(np.exp((least - score) / TEMPERED)) for name, score in scores.items()},
        held_out_run(task, chosen.values, chosen.effects) + known.held_out,
        parameters,
    )
