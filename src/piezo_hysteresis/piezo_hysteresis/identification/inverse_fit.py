"""Inverse model of Xiao 2014: fitted from displacement to voltage, evaluated in free run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import Block
from piezo_hysteresis.blocks.base import InverseRole, Slot
from piezo_hysteresis.blocks.bouc_wen import exact_kernel
from piezo_hysteresis.blocks.inverse_bouc_wen import KNOTS, SELECTOR, SINGLE
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit import FitResult, pooled_noise, result_at, target_weights
from piezo_hysteresis.identification.fit_data import targets_of
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.identification.global_search import Swarm, search
from piezo_hysteresis.identification.initial_conditions.record_start import NEAR_ZERO
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective, Prior
from piezo_hysteresis.identification.output_error import leaves_noise, output_error, suited
from piezo_hysteresis.identification.periods import period_of
from piezo_hysteresis.identification.starts import linear_parameters
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import failing_as, solve_least_squares
from piezo_hysteresis.records import Record

NAMES = ('inverse_gain', 'inverse_A', 'inverse_beta', 'inverse_gamma')

# Periods used at the end of a record that does not begin at rest; the first is the lead-in.
_PERIODS = 4

#: ``solver(residual)`` returns c, a, b and g / b in units of stroke and swing, shape (4,).
Solver = Callable[[Callable[[FloatArray], FloatArray]], FloatArray]

# With |g| below b and a negative a the voltage rises with the displacement.
_LOW, _HIGH = np.array([1e-2, -50.0, 1e-2, -0.99]), np.array([10.0, 0.0, 100.0, 0.99])
# Where b and g / b are scanned; c and a are solved for at each point.
_SCAN = [(b, ratio) for b in np.geomspace(0.1, 30.0, 8) for ratio in (-0.9, -0.5, 0.0, 0.5, 0.9)]
_FOLLOWED = 3
# Samples from which the speed is estimated if no frequency is known: more add noise.
_SEEN = 2000


@dataclass(frozen=True)
class InverseBoucWen:
    """``u = c r - h, dh = a dr - b |dr| h - g dr |h|`` with displacement in and voltage out."""

    slope: float  # slope of the reference of the fitted record [m/s]
    c: float  # [V/m]
    a: float  # [V/m]
    b: float  # [1/m]
    g: float  # [1/m]


def by_least_squares(residual: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the best of several Levenberg-Marquardt fits."""
    from scipy.optimize import least_squares

    starts = sorted((_scanned(residual, b, ratio) for b, ratio in _SCAN), key=lambda each: each[0])
    inside = 1e-3 * (_HIGH - _LOW)
    fits = [
        least_squares(
            residual,
            np.clip(point, _LOW + inside, _HIGH - inside),
            bounds=(_LOW, _HIGH),
            x_scale='jac',
        )
        for _, point in starts[:_FOLLOWED]
    ]
    return np.asarray(min(fits, key=lambda fit: float(fit.cost)).x, dtype=np.float64)


def _scanned(
    residual: Callable[[FloatArray], FloatArray], b: float, ratio: float
) -> tuple[float, FloatArray]:
    """Return cost and point with c and a at their optimum; the residual is affine in both."""
    none = residual(np.array([0.0, 0.0, b, ratio]))
    columns = np.column_stack(
        [
            residual(np.array([1.0, 0.0, b, ratio])) - none,
            residual(np.array([0.0, -1.0, b, ratio])) - none,
        ]
    )
    c, a = solve_least_squares(columns, -none).values
    point = np.clip(np.array([c, -a, b, ratio]), _LOW, _HIGH)
    missed = residual(point)
    return float(missed @ missed), point


def by_swarm(seed: int, max_evaluations: int, swarm: Swarm | None = None) -> Solver:
    """Return a solver that minimises Xiao 2014 (2) by particle swarm, as Xiao 2014 does.

    The particles search log(b) and g / b; c and a, in which the law is linear, are solved for at
    each particle.
    """
    low, high = np.array([np.log(_LOW[2]), _LOW[3]]), np.array([np.log(_HIGH[2]), _HIGH[3]])

    def solve(residual: Callable[[FloatArray], FloatArray]) -> FloatArray:
        def cost(z: FloatArray) -> float:
            return _scanned(residual, float(np.exp(z[0])), float(z[1]))[0]

        found = search(
            cost, low, high, method='pso', seed=seed, max_evaluations=max_evaluations, swarm=swarm
        )
        return _scanned(residual, float(np.exp(found.x[0])), float(found.x[1]))[1]

    return solve


def fit_inverse(
    displacement: FloatArray,  # [m] (n,)
    voltage: FloatArray,  # [V] (n,)
    slope: float,  # [m/s]
    warm_up: int = 0,
    solver: Solver = by_least_squares,
    *,
    from_rest: bool = False,
) -> InverseBoucWen:
    """Fit one row of the selector to a record of triangles at one slope."""
    stroke, swing = float(np.ptp(displacement)), float(np.ptp(voltage))
    if not (stroke > 0 and swing > 0):
        raise IdentificationError('the record does not move; record triangles over the stroke')
    x = np.ascontiguousarray(displacement / stroke)
    x = x - x[0]
    u = voltage / swing

    def residual(p: FloatArray) -> FloatArray:
        answer = np.empty(x.size)
        exact_kernel(
            x, answer, np.zeros(2), np.array([p[0], p[1], 0.0, p[2], p[3] * p[2]]), 1.0, 0.0
        )
        missed = (answer - u)[warm_up:]
        return np.asarray(missed if from_rest else missed - missed.mean())

    with failing_as(IdentificationError(f'the inverse at {slope:g} m/s could not be fitted')):
        c, a, b, ratio = (float(value) for value in solver(residual))
    return InverseBoucWen(
        slope, c * swing / stroke, a * swing / stroke, b / stroke, ratio * b / stroke
    )


def row_of(record: Record, solver: Solver = by_least_squares) -> InverseBoucWen:
    """Return the row of a record: of the whole if it begins at rest, else of its last periods.

    Its slope is the mean over a period; for triangles that is the slope between the tips.
    """
    period = period_of(record)
    count = min(_PERIODS, len(record) // period) if period else 0
    last = slice(len(record) - count * period, None)
    # a displacement is measured before the voltage of its tick acts
    y, u = record.displacement[1:], record.voltage[:-1]
    from_rest = abs(float(u[0])) <= NEAR_ZERO * float(np.max(np.abs(u)))
    slope = _slope(record.displacement[last] if count else record.displacement, record)
    warm_up = record.warm_up_samples
    if not from_rest and count > 1:
        y, u, warm_up = y[last], u[last], period
    whole = np.isfinite(y) & np.isfinite(u)
    return fit_inverse(y[whole], u[whole], slope, warm_up, solver, from_rest=from_rest)


def _slope(displacement: FloatArray, record: Record) -> float:
    """Return the mean speed of a displacement [m/s]."""
    if record.info.frequency > 0.0:
        return 2.0 * record.info.frequency * float(np.ptp(displacement))
    thin = displacement[:: max(1, displacement.size // _SEEN)]
    return float(np.abs(np.diff(thin)).sum()) / (displacement.size * record.dt)


def selector_table(rows: Sequence[InverseBoucWen]) -> dict[str, float]:
    """Return the parameters of the block ``inverse_selector`` for rows of any slopes.

    Its knots are equally spaced up to the steepest row; values between rows are interpolated.
    """
    ordered = sorted(rows, key=lambda row: row.slope)
    slopes = np.array([row.slope for row in ordered])
    if len(ordered) < 2 or np.any(np.diff(slopes) <= 1e-3 * slopes[-1]):
        raise IdentificationError(
            'the slope selector needs fits at two or more different slopes; record triangles of '
            'several frequencies'
        )
    span = float(slopes[-1])
    knots = span * np.arange(1, KNOTS + 1) / KNOTS
    table = {'selector_slope': span}
    for name, key in zip(NAMES, ('c', 'a', 'b', 'g'), strict=True):
        column = np.interp(knots, slopes, [getattr(row, key) for row in ordered])
        table.update({f'{name}_at{i}': float(v) for i, v in enumerate(column, start=1)})
    return table


# Each evaluation includes derivatives by forty unknowns.
_SELECTOR_EVALUATIONS = 40
#: Relative standard deviation of the prior of each row about the common row: a row without data
#: at its slope stays at the common row.
_LOOSE = 0.1


def law_of(model: Model) -> Block | None:
    """Return the inverse block of a chain, from displacement to voltage, as in Xiao 2014."""
    return next((block for block in model.blocks if block.role is InverseRole.SELECTOR), None)


def _selects(model: Model) -> bool:
    law = law_of(model)
    return law is not None and law.name == SELECTOR.name


def start_of(
    model: Model, records: Sequence[Record], solver: Solver = by_least_squares
) -> tuple[Model, dict[str, float]]:
    """Return a chain with the inverse of Xiao 2014 scaled to the records, and start values.

    The last knot of a selector is placed at the steepest record, unless its value is held.
    """
    if _selects(model):
        rows = {f'{row.slope:.2g}': row for row in (row_of(each, solver) for each in records)}
        found = selector_table(list(rows.values()))
        span = found.pop('selector_slope')
        # defaults of the blocks; a held value is the default of the model's own parameters
        default = {q.name: q.default for block in model.blocks for q in block.parameters}
        if model.held.get('selector_slope') == default['selector_slope']:
            model = model.hold(selector_slope=span)
        else:
            found = _at_knots(found, span, model.held['selector_slope'])
    else:
        row = row_of(min(records, key=lambda record: record.info.frequency), solver)
        found = dict(zip(NAMES, (row.c, row.a, row.b, row.g), strict=True))
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


def _selector(
    model: Model, records: Sequence[Record], start: Mapping[str, float], options: Mapping[str, Any]
) -> FitResult:
    """Fit a selector, starting from the data or from one row for all slopes.

    The result is never worse than the single row. A selector integrates voltage increments and
    has no zero of its own, so every record has its own; the offset is the mean error of the free
    runs.
    """
    chain, found = start_of(model, records)
    plain = output_error(chain, records, start=start, **options)
    if leaves_noise(plain):
        return plain
    options = {'zero': 'record', **options}
    single, law = start_of(model.with_replaced(SELECTOR.name, SINGLE), records)
    one = output_error(single, records, guesses=(law,), **options)
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
    fitted = output_error(chain, records, start=known, free=free, **{**options, 'count': 1})
    if plain.rms < fitted.rms:
        return plain
    zero = zero_of(chain, fitted.values, records)
    return replace(fitted, values={**fitted.values, 'offset': zero})


def output_error_in_stages(
    model: Model,
    records: Sequence[Record],
    *,
    start: Mapping[str, float] | None = None,
    **options: Any,
) -> FitResult:
    """Fit a chain by `output_error`, and one with additions in stages.

    The fit of an inverse law of Xiao 2014 starts from its direct identification, which records
    that begin in motion bias: from other values, too.
    """
    if _selects(model):
        return _selector(model, records, start or {}, options)
    if law_of(model):
        chain, law = start_of(model, records)
        return output_error(chain, records, start=start or {}, guesses=(law,), **options)
    added = _added(model)
    known = set(start or {})
    without = tuple(name for name in model.free_names if name not in added)
    if not added or known & set(added) or not without:
        return output_error(model, records, start=start, **options)
    chain = suited(model, records)
    reach = max(float(abs(record.voltage).max()) for record in records)
    linear = set(linear_parameters(chain, added, reach))
    found = output_error(chain, records, start=start, free=without, **options)
    begin = {**found.values, SAMPLING_OFFSET: found.sampling_offset}
    names = tuple(n for n in model.free_names if n not in set(added) - linear)
    found = output_error(chain, records, start=begin, free=names, **{**options, 'count': 1})
    # the first stage may be biased by the error that the additions explain
    begin = {**found.values, SAMPLING_OFFSET: found.sampling_offset}
    return output_error(chain, records, start=start, guesses=(begin,), **options)


def _added(model: Model) -> tuple[str, ...]:
    """Return the unknowns of the blocks that add a signal to the output of the chain."""
    names = {q.name for b in model.blocks if b.slot is Slot.ADDED for q in b.parameters}
    return tuple(name for name in model.free_names if name in names)
