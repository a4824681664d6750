"""Parts of a chain that the records do not determine are omitted or held, with a message.

A mode above the frequencies of the records does not affect the fit: its values are arbitrary, and
it makes every later simulation slower. If it affects the fit, but its values are correlated, one
of them is held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InverseRole, Slot
from piezo_hysteresis.identification.fit import FitResult, fit
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.uncertainty import digits, help_for, inflation
from piezo_hysteresis.models import Model, name_of
from piezo_hysteresis.numerics.linalg import column_norms, solve_least_squares
from piezo_hysteresis.records import Record

# Relative deviation of a value above which, and samples per period of a frequency below which, a
# block is tested. Chosen; they only select blocks for the test.
_UNCERTAIN, _SAMPLES_PER_PERIOD = 0.25, 10.0

_NONE: Mapping[str, float] = {}


def drop_unidentifiable(
    found: FitResult, records: Sequence[Record], options: Mapping[str, Any]
) -> tuple[FitResult, tuple[str, ...]]:
    """Return a fit without undetermined blocks, and sentences on omitted blocks and held values.

    The hysteresis and the zero are always kept.
    """
    remarks: list[str] = []
    more = {k: v for k, v in options.items() if k not in ('start', 'count', 'free', 'guesses')}
    clock = more.get('sampling_offset', True)
    for block in found.model.blocks:
        uncertain = _uncertain(block, found)
        if block.slot is Slot.HYSTERESIS or block.role is InverseRole.ZERO or not uncertain:
            continue
        less = _refitted(found.model.without(block), found, clock)
        if not _explains(found, less):
            remarks.append(_words(block, found))
            start = {**less.values, SAMPLING_OFFSET: less.sampling_offset}
            plain = replace(less.model, name=name_of(less.model) or less.model.name)
            found = output_error(plain, records, start=start, count=1, **more)
            continue
        held = _with_one_held(block, found, uncertain, clock)
        if held is not None:
            (name,) = set(held.model.held) - set(found.model.held)
            remarks.append(
                f'the records do not separate {" and ".join(uncertain)}: {name} is held at '
                f'{held.values[name]:.4g} {_unit(name, found)}, and the other values hold for '
                f'it only; {help_for(uncertain)}.'.replace(' ,', ',')
            )
            found = held
    return found, tuple(remarks)


def _uncertain(block: Block, found: FitResult) -> list[str]:
    """Return the poorly determined values of a block, by decreasing uncertainty."""
    unsure: dict[str, float] = {}
    for name in found.model.names_of(block).values():
        size = abs(found.values[name])
        if name in found.std and (
            _too_fast(name, found) or not found.std[name] <= _UNCERTAIN * size
        ):
            unsure[name] = found.std[name] / size if size > 0.0 else float('inf')
    return sorted(unsure, key=lambda name: -unsure[name])


def _too_fast(name: str, found: FitResult) -> bool:
    rate = 1.0 / min(target.dt for target in found.targets)
    return _unit(name, found) == 'Hz' and found.values[name] > rate / _SAMPLES_PER_PERIOD


def _with_one_held(
    block: Block, found: FitResult, uncertain: Sequence[str], clock: bool | float
) -> FitResult | None:
    """Return the fit with one of several values held, if that does not increase the cost."""
    if len(uncertain) < 2:  # a single value is as uncertain as its deviation states
        return None
    half = 0.5 / min(target.dt for target in found.targets)
    for name in uncertain:
        most = half if _unit(name, found) == 'Hz' else float('inf')
        for value in (found.model.defaults()[name], found.values[name]):
            held = min(value, most)
            # often only the ratio of the values is determined
            ratio = held / found.values[name] if found.values[name] else 1.0
            fits = [
                _refitted(
                    found.model.hold(**{name: held}),
                    found,
                    clock,
                    {other: factor * found.values[other] for other in uncertain if other != name},
                )
                for factor in {1.0, ratio}
            ]
            less = min(fits, key=lambda each: each.cost)
            fast = any(_too_fast(each, less) for each in _uncertain(block, less))
            if not fast and not _explains(found, less):
                return less
    return None


def _refitted(
    smaller: Model, found: FitResult, clock: bool | float, begin: Mapping[str, float] = _NONE
) -> FitResult:
    """Return a fit of a reduced chain to the data of the whole chain."""
    values = {name: found.values[name] for name in smaller.parameter_names}
    start = values | dict(begin) | dict(smaller.held)
    start[SAMPLING_OFFSET] = found.sampling_offset
    return fit(smaller, (), start, targets=found.targets, sampling_offset=clock)


def _explains(whole: FitResult, less: FitResult) -> bool:
    """Return whether the BIC prefers the larger chain (Schwarz 1978).

    Residuals are correlated and contain fewer independent values than samples.
    """
    if not (np.isfinite(less.cost) and less.cost > 0.0 and whole.cost > 0.0):
        return bool(less.cost > whole.cost)
    errors = list(less.residuals.values())
    parameters = len(whole.free) - len(less.free)
    independent = max(sum(e.size for e in errors) / inflation(errors), 2.0)
    return bool(independent * np.log(less.cost / whole.cost) > parameters * np.log(independent))


def _words(block: Block, found: FitResult) -> str:
    names = [name for name in found.model.names_of(block).values() if name in found.std]
    values = ', '.join(
        f'{name} {digits(found.values[name], found.std[name])} {_unit(name, found)}'.rstrip()
        for name in names
    )
    return (
        f'the records do not show the block {block.name}, which is removed ({values}): '
        f'{help_for(names)}.'
    )


def _unit(name: str, found: FitResult) -> str:
    unit = next(q.unit for q in found.model.parameters if q.name == name)
    return '' if unit == '1' else unit


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
    # one error of a converter for each reach in two digits, which does not average out
    reaches = [f'{np.ptp(each.voltage):.2g}' for each in objective.targets]
    drawn: dict[str, float] = {}
    for reach in reaches:
        drawn.setdefault(reach, float(generator.standard_normal()))
    other.targets = tuple(
        _with_error(each, generator, drawn[reach])
        for each, reach in zip(objective.targets, reaches, strict=True)
    )
    return other


def _with_error(target: FitData, generator: np.random.Generator, converter: float) -> FitData:
    error = target.input_uncertainty
    if error is None:
        return target
    drawn = error.draw(target.voltage, target.repeats, generator, converter)
    return replace(target, voltage=target.voltage + drawn)


def _step(objective: Objective, x: FloatArray, known: np.ndarray) -> FloatArray:
    """Return the Gauss-Newton step of the parameters that the records determine."""
    factor, gradient, _ = objective.linearise(x)
    columns = factor[:, known]
    norms = np.maximum(column_norms(columns), 1e-300)
    return np.asarray(-solve_least_squares(columns / norms, gradient, 1e-12).values / norms)
