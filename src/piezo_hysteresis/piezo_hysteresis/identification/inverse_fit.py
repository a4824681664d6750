"""Inverse model of Xiao 2014: fitted from displacement to voltage, evaluated in free run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_hysteresis.blocks import Block
from piezo_hysteresis.blocks.base import Part
from piezo_hysteresis.blocks.inverse_bouc_wen import SELECTOR, SINGLE
from piezo_hysteresis.identification.fit import target_weights
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.identification.inverse_rows import (
    Solver,
    by_least_squares,
    inverse_parameters,
)
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective, Prior
from piezo_hysteresis.identification.output_error import leaves_noise, output_error, suited
from piezo_hysteresis.identification.result import FitResult, pooled_noise, result_at
from piezo_hysteresis.identification.targets import targets_of
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record

# Each evaluation includes derivatives by forty unknowns.
_SELECTOR_EVALUATIONS = 40
#: Relative standard deviation of the prior of each row about the common row: a row without data
#: at its slope stays at the common row.
_LOOSE = 0.1


def law_of(model: Model) -> Block | None:
    """Return the inverse block of a chain, from displacement to voltage, as in Xiao 2014."""
    return next((block for block in model.blocks if block.part is Part.SELECTOR), None)


def _selects(model: Model) -> bool:
    law = law_of(model)
    return law is not None and law.name == SELECTOR.name


def start_of(
    model: Model, records: Sequence[Record], solver: Solver = by_least_squares
) -> tuple[Model, dict[str, float]]:
    """Return a chain with the inverse of Xiao 2014 scaled to the records, and start values.

    The last knot of a selector is placed at the steepest record, unless its value is held.
    """
    selector = _selects(model)
    found = inverse_parameters(records, selector, solver)
    span = found.pop('selector_slope', 0.0)
    # defaults of the blocks; a held value is the default of the model's own parameters
    default = {q.name: q.default for block in model.blocks for q in block.parameters}
    if selector and model.held.get('selector_slope') == default['selector_slope']:
        model = model.hold(selector_slope=span)
    elif selector:
        found = _at_knots(found, span, model.held['selector_slope'])
    return suited(model, records), {n: v for n, v in found.items() if n in model.free_names}


def _at_knots(found: Mapping[str, float], span: float, target: float) -> dict[str, float]:
    """Return a table over slopes up to `span` at the knots of one up to `target`."""
    names = sorted({name.rsplit('_at', 1)[0] for name in found})
    count = len(found) // len(names)
    here = np.arange(1, count + 1) / count
    moved = {}
    for name in names:
        column = [found[f'{name}_at{i}'] for i in range(1, count + 1)]
        values = np.interp(target * here, span * here, column)
        moved.update({f'{name}_at{i}': float(v) for i, v in enumerate(values, start=1)})
    return moved


def fit_direct(
    model: Model,
    records: Sequence[Record],
    solver: Solver = by_least_squares,
    *,
    weights: str | Mapping[str, float] = 'equal',
    folded: bool = True,
) -> FitResult:
    """Return the direct identification of an inverse by Xiao 2014, with its free-run errors."""
    chain, found = start_of(model, records, solver)
    values = {**chain.defaults(), **found}
    values['offset'] = zero_of(chain, values, records)
    targets = targets_of(records, folded=folded, zero='record')
    free = tuple(name for name in chain.free_names if name != 'offset')
    objective = Objective(chain, targets, free, values, weights=target_weights(targets, weights))
    return result_at(
        objective,
        values,
        converged=True,
        message='from displacement to voltage',
        evaluations=len(records),
        history=(),
    )


def zero_of(model: Model, values: Mapping[str, float], records: Sequence[Record]) -> float:
    """Return the mean free-run error of a chain over records with a slow lead-in [m]."""
    packed = model.pack({**values, 'offset': 0.0}, checked=False)
    missed = [
        float(np.mean(t.measured - t.pick(simulated(model, packed, t))))
        for t in targets_of(records, folded=False, start='rest')
    ]
    return float(np.clip(np.mean(missed), -1.0, 1.0)) if np.all(np.isfinite(missed)) else 0.0


def output_error_of_inverse(
    model: Model,
    records: Sequence[Record],
    *,
    start: Mapping[str, float] | None = None,
    **options: Any,
) -> FitResult:
    """Fit an inverse law of Xiao 2014 by output error, starting from its direct identification.

    A selector integrates voltage increments and has no zero of its own, so every record has its
    own zero; the offset is the mean error of the free runs.
    """
    if _selects(model):
        return _selector(model, records, start or {}, options)
    chain, found = start_of(model, records)
    return _one_row(chain, records, found, start or {}, options)


def _one_row(
    chain: Model,
    records: Sequence[Record],
    found: Mapping[str, float],
    start: Mapping[str, float],
    options: Mapping[str, Any],
) -> FitResult:
    """Fit from several starts: records that begin in motion bias the direct identification."""
    return output_error(chain, records, start=start, guesses=(found,), **options)


def _selector(
    model: Model, records: Sequence[Record], start: Mapping[str, float], options: Mapping[str, Any]
) -> FitResult:
    """Fit a selector, starting from the data or from one row for all slopes.

    The result is never worse than the single row.
    """
    chain, found = start_of(model, records)
    plain = output_error(chain, records, start=start, **options)
    if leaves_noise(plain):
        return plain
    options = {'zero': 'record', **options}
    single, law = start_of(_single(model), records)
    one = _one_row(single, records, law, {}, options)
    rows = {name: one.values[name.rsplit('_at', 1)[0]] for name in found}
    values = {**chain.defaults(), **one.values, **rows, **start}
    known = {name: values[name] for name in chain.parameter_names}
    known[SAMPLING_OFFSET] = one.sampling_offset
    free = tuple(name for name in chain.free_names if name != 'offset')
    scales = {q.name: q.scale for q in chain.parameters}
    priors = {n: Prior(v, _LOOSE * max(abs(v), scales[n])) for n, v in rows.items()}
    if np.isfinite(pooled_noise(plain.targets)):
        options = {'priors': priors, **options}
    options = {'max_evaluations': _SELECTOR_EVALUATIONS, **options}
    fitted = output_error(chain, records, start=known, free=free, count=1, **options)
    if plain.rms < fitted.rms:
        return plain
    zero = zero_of(chain, fitted.values, records)
    return replace(fitted, values={**fitted.values, 'offset': zero})


def _single(model: Model) -> Model:
    """Return the chain with one row instead of the rows of a selector."""
    blocks = tuple(SINGLE if block.name == SELECTOR.name else block for block in model.blocks)
    names = {q.name for block in blocks for q in block.parameters}
    return Model(model.name, blocks, {n: v for n, v in model.held.items() if n in names})
