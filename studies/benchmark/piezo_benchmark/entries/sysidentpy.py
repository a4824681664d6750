"""SysIdentPy: forward regression (FROLS, BIC) over inputs that are the effects' own equations.

As for PySINDy: the discrepancy of the fitted baseline is the output of an NFIR model, each effect
of the list (by its equation, the tangent of the baseline taken out) one input, degree one, one
lag. Inputs are shifted by one sample so that lag one is the present. A chosen input gives its
name; none chosen, or less than 5 % explained, is `none`, less than 30 % is `unknown`.
Probabilities are calibrated as those of every entry (`calibrated`).
"""

from __future__ import annotations

import contextlib
import io
import warnings

import numpy as np

from piezo_benchmark.entries.calibrated import Statement, answered
from piezo_benchmark.entries.common import library
from piezo_benchmark.tasks import Answer, Task

TERMS, LEAST = 5, 1e-3


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('sysidentpy', task, statement(task))


def statement(task: Task) -> Statement:
    """Return the names of the chosen inputs."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    lib = library(task)
    count = len(lib.parts)
    inputs = np.concatenate([lib.columns[1:], np.zeros((1, count))])
    model = FROLS(
        order_selection=True,
        n_info_values=TERMS,
        xlag=[[1]] * count,
        info_criteria='bic',
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=1),
        model_type='NFIR',
    )
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter('ignore')
        model.fit(X=inputs, y=lib.target[:, None])
    weights = np.zeros(count)
    codes = np.asarray(model.final_model).reshape(len(model.theta), -1)
    for code, value, share in zip(
        codes.max(1), np.ravel(model.theta), np.ravel(model.err), strict=False
    ):
        if code >= 2000 and share > LEAST:
            weights[int(code) // 1000 - 2] = float(value)
    if np.any(weights):  # a term omitted for its small share changes the rest
        kept = np.flatnonzero(weights)
        weights[kept] = np.linalg.lstsq(lib.columns[:, kept], lib.target, rcond=None)[0]
    return lib.statement(weights)
