"""Deviations of parameters by the error of a measured input.

The covariance of a fit contains the noise of the output only. An error of the input moves every
sample that follows it, and parameters absorb part of it. Drawn errors are added to the input, and
each moves the parameters by a Gauss-Newton step, so that a bias counts as well.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.objective import Objective
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.numerics.linalg import column_norms, solve_least_squares

_DRAWS = 16  # give a deviation within 18 %


def with_input_error(fit: FitResult) -> FitResult:
    """Return a fit whose covariance contains the error of its inputs."""
    spread = fit.covariance
    known = np.flatnonzero(np.isfinite(spread.std))
    if not known.size or not any(target.input_uncertainty for target in fit.targets):
        return fit
    generator = np.random.default_rng(0)
    usual = _step(fit.objective, fit.solution.x, known)
    moves = np.array(
        [_step(_drawn(fit.objective, generator), fit.solution.x, known) for _ in range(_DRAWS)]
    )
    moves = moves[np.all(np.isfinite(moves), axis=1)] - usual
    if not len(moves):
        return fit
    std, correlation = spread.std.copy(), spread.correlation.copy()
    together = np.ix_(known, known)
    total = correlation[together] * np.outer(std[known], std[known])
    total += moves.T @ moves / len(moves)
    std[known] = np.sqrt(np.diag(total))
    correlation[together] = total / np.maximum(np.outer(std[known], std[known]), 1e-300)
    return replace(fit, covariance=replace(spread, std=std, correlation=correlation))


def _drawn(objective: Objective, generator: np.random.Generator) -> Objective:
    other = copy(objective)
    other.targets = tuple(_with_error(target, generator) for target in objective.targets)
    return other


def _with_error(target: Target, generator: np.random.Generator) -> Target:
    error = target.input_uncertainty
    if error is None:
        return target
    return replace(
        target, voltage=target.voltage + error.draw(target.voltage.size, target.repeats, generator)
    )


def _step(objective: Objective, x: FloatArray, known: np.ndarray) -> FloatArray:
    """Return the Gauss-Newton step of the parameters that the records determine."""
    factor, gradient, _ = objective.linearise(x)
    columns = factor[:, known]
    norms = np.maximum(column_norms(columns), 1e-300)
    return np.asarray(-solve_least_squares(columns / norms, gradient, 1e-12).values / norms)
