"""Xiao 2014's inverse as a model: fitted from displacement to voltage, judged from voltage on."""

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

# Each costs a derivative by forty unknowns.
_SELECTOR_EVALUATIONS = 40
#: Standard deviation of a row of the table about the one row for all slopes before the data,
#: relatively: a slope that no record shows leaves its row where it is.
_LOOSE = 0.1


def law_of(model: Model) -> Block | None:
    """Return the block of a chain that leads from displacement to voltage, as Xiao 2014 has it."""
    return next((block for block in model.blocks if block.part is Part.SELECTOR), None)


def _selects(model: Model) -> bool:
    law = law_of(model)
    return law is not None and law.name == SELECTOR.name


def start_of(
    model: Model,
    records: Sequence[Record],
    solver: Solver = by_least_squares,
) -> tuple[Model, dict[str, float]]:
    """Return a chain with Xiao 2014's inverse suited to records, and values for its law.

    The last knot of a selector is put at the steepest record, unless somebody held it elsewhere.
    """
    selector = _selects(model)
    found = inverse_parameters(records, selector, solver)
    span = found.pop('selector_slope', 0.0)
    # of the blocks: what is held is the default of the parameters of the model itself
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
    """Return Xiao 2014's identification of an inverse as it is, with its worth as a model.

    Parameters
    ----------
    model : Model
        A chain with one of Xiao 2014's laws.
    records : sequence of Record
        For the selector of two or more slopes.
    solver : callable
        See `inverse_rows.Solver`.
    weights, folded
        See `fit`.
    """
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
    """Return the offset that a chain misses on average over records, led in slowly [m]."""
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
    """Fit one of Xiao 2014's laws by output error, from where its direct identification leads.

    A selector adds voltages up and has no zero of its own, so every record has its own; the offset
    is what the free runs miss on average.
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
    """Fit from the direct identification, and from elsewhere: a record in motion misleads it."""
    return output_error(chain, records, start=start, guesses=(found,), **options)


def _selector(
    model: Model,
    records: Sequence[Record],
    start: Mapping[str, float],
    options: Mapping[str, Any],
) -> FitResult:
    """Fit a selector from the data, and where that misses from one row for all slopes.

    It is never worse than that row.
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
    """Return the chain with one row in the place of those of a selector."""
    blocks = tuple(SINGLE if block.name == SELECTOR.name else block for block in model.blocks)
    names = {q.name for block in blocks for q in block.parameters}
    return Model(model.name, blocks, {n: v for n, v in model.held.items() if n in names})
