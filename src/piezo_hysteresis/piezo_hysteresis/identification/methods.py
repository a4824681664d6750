"""Identification methods by name, their options, and the global search of a chain."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.common.wording import choices, near
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit import FARTHEST, FitResult, result_at, target_weights
from piezo_hysteresis.identification.fit_data import FitData, targets_of
from piezo_hysteresis.identification.global_search import METHODS as SEARCHES
from piezo_hysteresis.identification.global_search import (
    SWARMS,
    Progress,
    SearchResult,
    Swarm,
    search,
)
from piezo_hysteresis.identification.initial_conditions.revision import (
    RecordAssumptions,
    estimate_nuisances,
)
from piezo_hysteresis.identification.inverse_fit import by_swarm, fit_direct, law_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.online import ONLINE_METHODS
from piezo_hysteresis.identification.output_error import output_error, suited
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record

GENERAL: tuple[str, ...] = ('output_error', *ONLINE_METHODS, *SEARCHES)


@dataclass(frozen=True)
class PaperMethod:
    """A method of a paper."""

    base: str  # the general method that implements it
    description: str  # one sentence
    options: Mapping[str, Any] = field(default_factory=dict)  # options set by the paper


PAPERS: dict[str, PaperMethod] = {
    'fujii2018': PaperMethod(
        'rls', 'Fujii 2018 (8)-(12), recursive least squares from P0 = I in mm.', {'variant': 'V1'}
    ),
    'tatebatake2017': PaperMethod(
        'rls', 'Tatebatake 2017 (8)-(11), its regressor as printed.', {'variant': 'V2'}
    ),
    'zhou2021': PaperMethod(
        'pso',
        'Zhou 2021: a swarm for the hysteresis at the slowest frequency, then one for the '
        'structure at the fastest.',
        {'steps': 'two', 'sampling_offset': False},
    ),
    'xiao2014': PaperMethod(
        'pso',
        'Xiao 2014: a swarm for all parameters; of an inverse from displacement to voltage, of '
        'the selector row by row.',
        {'steps': 'one', 'direct': True},
    ),
    'fang2019': PaperMethod(
        'pso_modified',
        'Fang 2019: a constricted swarm whose inertia falls, for all parameters.',
        {'steps': 'one', 'sampling_offset': False},
    ),
}

METHODS: tuple[str, ...] = (*GENERAL, *PAPERS)


def base_of(method: str) -> str:
    """Return the general method behind a name."""
    if not isinstance(method, str):
        raise IdentificationError(
            f'a method is one of {", ".join(METHODS)}, not of type {type(method).__name__}'
        )
    if method not in METHODS:
        raise IdentificationError(f'method {method!r} is unknown{choices(method, METHODS)}')
    return PAPERS[method].base if method in PAPERS else method


def options_implied_by(method: str) -> Mapping[str, Any]:
    """Return the options that a method name implies."""
    return PAPERS[method].options if method in PAPERS else {}


# Nuisances of the records are estimated again once, after the first search.
_TURNS = 2


def _box(
    model: Model, targets: Sequence[FitData], free: Sequence[str]
) -> tuple[FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
    """Return bounds that suit the gain, range and rate of the data, and the point of a search.

    An unknown of which only the order of magnitude is known is searched by its logarithm.
    """
    known = {q.name: q for q in model.parameters}
    special = _ranges(targets)
    step = min(t.dt for t in targets)
    rows, logarithmic = [], []
    for name in free:
        if name == SAMPLING_OFFSET:
            rows.append((-FARTHEST * step, FARTHEST * step))
            logarithmic.append(False)
            continue
        q = known[name]
        if name in special:
            low, high = special[name]
        elif q.low > 0 or (q.low == 0 and q.default > 0):
            low, high = q.default / 20, q.default * 20
        else:
            low, high = q.default - 4 * q.scale, q.default + 4 * q.scale
        low, high = max(low, q.low), min(high, q.high)
        log = low > 0 and high / low > 30
        rows.append((np.log(low), np.log(high)) if log else (low, high))
        logarithmic.append(log)
    (lowest, highest), by_log = np.array(rows).T, np.array(logarithmic)
    return lowest, highest, lambda z: np.where(by_log, np.exp(np.where(by_log, z, 0.0)), z)


def _ranges(targets: Sequence[FitData]) -> dict[str, tuple[float, float]]:
    slowest = min(targets, key=lambda t: (t.frequency or np.inf, t.name))
    u = slowest.pick(slowest.voltage)
    y = slowest.measured
    swing = u - u.mean()
    gain = float(swing @ (y - y.mean())) / max(float(swing @ swing), 1e-300)
    amplitude = max(float(np.max(np.abs(t.voltage))) for t in targets)
    span = max(float(np.ptp(t.measured)) for t in targets)
    middle = float(y.mean())
    one, other = 0.5 * gain, 3 * gain
    return {
        'A1': (min(one, other), max(one, other)),
        'A': (min(2 * gain, 0.0), max(2 * gain, 0.0)),
        'A0': (-0.2 * abs(gain), 0.2 * abs(gain)),
        'beta': (0.05 / amplitude, 20 / amplitude),
        'gamma': (-3 / amplitude, 3 / amplitude),
        'natural_frequency': (
            2 * min((t.frequency for t in targets if t.frequency > 0), default=0.5),
            0.45 / min(t.dt for t in targets),
        ),
        'damping_ratio': (1e-3, 2.0),
        'offset': (middle - span / 2, middle + span / 2),
    }


def identify_by_search(
    model: Model,
    records: Sequence[Record],
    method: str,
    *,
    seed: int = 0,
    max_evaluations: int = 4000,
    swarm: Mapping[str, float] | None = None,
    steps: str = 'auto',
    direct: bool = False,
    weights: str | Mapping[str, float] = 'equal',
    folded: bool = True,
    sampling_offset: bool = True,
    begins: str = 'auto',
    zero: str = 'auto',
    workers: int = 1,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a chain by global search.

    The swarms search a chain with a structure in the two steps of Zhou 2021: the hysteresis on the
    slowest record with a rigid structure, then the structure on the fastest. The other methods
    search all unknowns on all records together. The inverse of Xiao 2014 can be searched from
    displacement to voltage, row by row.
    """
    constants = swarm_of(method, swarm or {})
    if direct and law_of(model):
        solver = by_swarm(seed, max_evaluations, constants)
        return fit_direct(model, records, solver, weights=weights, folded=folded)
    chain = suited(model, records)
    slow = any(block.slot == Slot.SLOW for block in chain.blocks)
    choices = RecordAssumptions(begins, zero)
    targets = targets_of(records, folded=folded and not slow, start=begins, zero=zero)
    late = (SAMPLING_OFFSET,) if sampling_offset else ()
    trail: list[SearchResult] = []
    for _ in range(_TURNS):
        values = {**chain.defaults(), SAMPLING_OFFSET: 0.0}
        for part, free, seen in _steps(chain, targets, method, steps):
            names = (*free, *late)
            low, high, point = _box(chain, seen, names)
            base = {name: values[name] for name in (*part.parameter_names, SAMPLING_OFFSET)}
            objective = Objective(
                part, seen, names, base, weights=target_weights(seen, weights), workers=workers
            )
            found = search(
                lambda z, point=point, objective=objective: objective.cost(point(z)),  # type: ignore[misc]
                low,
                high,
                method=method,
                seed=seed,
                max_evaluations=max_evaluations,
                swarm=constants,
                progress=progress,
            )
            trail.append(found)
            values.update(zip(names, (float(v) for v in point(found.x)), strict=True))
        own = {name: values[name] for name in chain.parameter_names}
        renewed = estimate_nuisances(
            chain, own, values[SAMPLING_OFFSET], targets, records, choices
        )
        if all(map(FitData.begins_like, renewed, targets)):
            break
        targets = renewed
    names = (*chain.free_names, *late)
    factors = target_weights(targets, weights)
    return result_at(
        Objective(chain, targets, names, values, weights=factors, workers=workers),
        values,
        converged=all(found.converged for found in trail),
        message='; '.join(found.message for found in trail),
        evaluations=sum(found.evaluations for found in trail),
        history=tuple(best for found in trail for best in found.history),
    )


def swarm_of(method: str, given: Mapping[str, float]) -> Swarm | None:
    """Return the constants of a swarm, None for other methods."""
    if method not in SWARMS:
        if given:
            raise IdentificationError(f'{method} is no swarm; leave its constants out')
        return None
    known = [f.name for f in fields(Swarm)]
    stray = [name for name in given if name not in known]
    if stray:
        raise IdentificationError(f'a swarm has no {stray[0]}; it has {", ".join(known)}')
    return replace(SWARMS[method], **given)  # type: ignore[arg-type]


def _steps(
    model: Model, targets: Sequence[FitData], method: str, steps: str
) -> list[tuple[Model, tuple[str, ...], list[FitData]]]:
    """Return chain, unknowns and records of each step; two steps are Zhou 2021 (6), (7)."""
    stiff = model
    for block in model.blocks:
        stiff = stiff.without(block) if block.slot == Slot.STRUCTURE else stiff
    structure = tuple(n for n in model.free_names if n not in stiff.parameter_names)
    order = sorted(targets, key=lambda t: t.frequency)
    apart = order[0].frequency < order[-1].frequency
    hysteretic = any(block.slot == Slot.HYSTERESIS for block in stiff.blocks)
    possible = bool(structure) and apart and hysteretic
    if steps == 'two' and not possible:
        raise IdentificationError(
            f'the two steps of Zhou 2021 need hysteresis, a structure with something to find and '
            f'two drive frequencies; {model.name} or the records lack one of them'
        )
    if possible and (steps == 'two' or (steps == 'auto' and method in SWARMS)):
        return [(stiff, stiff.free_names, order[:1]), (model, structure, order[-1:])]
    return [(model, model.free_names, list(targets))]


_COMMON = {'model', 'records', 'method', 'seed', 'workers', 'progress'}
_ONLINE = {
    'rls': ('forgetting', 'variant', 'offset', 'unit', 'p0', 'start', 'sampling_offset'),
    'rls_ud': ('forgetting', 'start', 'sampling_offset'),
    'pi_bank': ('forgetting', 'start', 'sampling_offset'),
}


@cache
def options_of(method: str) -> tuple[str, ...]:
    """Return the names of the options of a method."""
    base = base_of(method)
    if base in _ONLINE:
        return _ONLINE[base]
    function = output_error if base == 'output_error' else identify_by_search
    return tuple(name for name in inspect.signature(function).parameters if name not in _COMMON)


def require_options(method: str, names: Iterable[str]) -> None:
    """Raise an error for options that a method does not have."""
    known = options_of(method)
    for name in names:
        if name not in known:
            raise IdentificationError(
                f'{method} has no option {name}{near(name, known)}; it has {", ".join(known)}'
            )
