"""Parameters in which a chain is affine: detection by superposition and exact solution."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.free_run import read, samples_late
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, projected
from piezo_hysteresis.identification.sensitivities import FirstStage, sensitivities
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import triangle


def linear_parameters(model: Model, free: Sequence[str], amplitude: float) -> tuple[str, ...]:
    """Return the longest leading sequence of unknowns in which the response is jointly affine.

    It is found by superposition on a short test signal and holds for any chain: ``A1, A,
    offset`` of a Bouc-Wen chain (h is homogeneous in A > 0), each weight of a play bank.
    """
    # amplitude [V]
    k = np.arange(240)
    voltage = amplitude * (np.sin(0.19 * k) + 0.35 * np.sin(0.057 * k + 1.0)) / 1.35
    scales = {q.name: q for q in model.parameters}
    found: tuple[str, ...] = ()
    for name in free:
        q = scales.get(name)
        if q is None or q.high - q.low < 4 * q.scale:
            continue
        if _affine(model, (*found, name), voltage):
            found = (*found, name)
    return found


def _affine(model: Model, names: Sequence[str], voltage: FloatArray) -> bool:
    """Return whether the response is affine in `names` and depends on the last of them.

    A parameter without effect at the defaults (the recursion of a harmonic without input, a knot
    outside the signal) only appears to be affine.
    """
    scales = {q.name: q.scale for q in model.parameters}
    base = {**model.defaults(), **dict.fromkeys(names, 0.0)}
    rng = np.random.default_rng(0)
    one = {**base, **{n: float(rng.uniform(0.5, 1.5)) * scales[n] for n in names}}
    two = {**base, **{n: float(rng.uniform(0.5, 1.5)) * scales[n] for n in names}}
    both = {**base, **{n: one[n] + two[n] for n in names}}

    def run(values: Mapping[str, float]) -> FloatArray:
        packed = model.pack(values, checked=False)
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):  # time constants of 0
            return model.respond(voltage, packed, 1e-3, frequency=10.0)

    zero, first, second, total = run(base), run(one), run(two), run(both)
    scale = float(np.max(np.abs(first - zero), initial=0.0))
    alone = {**base, names[-1]: one[names[-1]]}
    with np.errstate(over='ignore', invalid='ignore'):
        if not np.max(np.abs(run(alone) - zero)) > 0.0:
            return False
        gap = float(np.max(np.abs(first + second - total - zero)))
    return bool(np.isfinite(gap) and gap <= 1e-7 * scale)


@dataclass
class Simulated:
    """Simulations of scanned points, which are also valid for other zeros of the same records."""

    points: dict[bytes, list[list[FloatArray]]] = field(default_factory=dict)
    first: defaultdict[str, FirstStage] = field(default_factory=lambda: defaultdict(FirstStage))


def solve_linear(
    model: Model,
    targets: Sequence[Target],
    values: Mapping[str, float],
    names: Sequence[str],
    simulated: Simulated,
    offsets: Sequence[float] = (0.0,),  # [s]
) -> dict[str, float]:
    """Return `values` with the unknowns `names` at their least-squares optimum."""
    known = {name: value for name, value in values.items() if name != SAMPLING_OFFSET}
    packed = model.pack({**known, **dict.fromkeys(names, 0.0)}, checked=False)
    key = packed.tobytes()
    if key not in simulated.points:
        every = [
            _factors(model, packed, names, target, simulated.first[target.name], offsets)
            for target in targets
        ]
        simulated.points[key] = [list(each) for each in zip(*every, strict=True)]
    solved = [
        (*_solved(targets, factors, model, names), offset)
        for factors, offset in zip(simulated.points[key], offsets, strict=True)
    ]
    _, best, offset = min(solved, key=lambda each: each[0])
    return {**values, **best, SAMPLING_OFFSET: offset}


def _solved(
    targets: Sequence[Target], factors: Sequence[FloatArray], model: Model, names: Sequence[str]
) -> tuple[float, dict[str, float]]:
    """Return the norm of the residual and the solution, which is empty if it is not unique."""
    p = len(names)
    if not all(np.all(np.isfinite(each)) for each in factors):
        return inf, {}
    parts = [
        target.weight * (projected(factor, 1) if target.own_zero else factor[:, 1:])
        for target, factor in zip(targets, factors, strict=True)
    ]
    full = triangle(np.ascontiguousarray(np.vstack(parts).T))
    norms = np.linalg.norm(full[:p, :p], axis=0)
    norms[norms == 0.0] = 1.0
    solved = solve_least_squares(full[:p, :p] / norms, full[:p, p], rcond=1e-7)
    if not solved.sound:
        return float(np.linalg.norm(full[:, p])), {}
    limits = {q.name: (q.low, q.high) for q in model.parameters}
    best = {
        name: float(np.clip(value, *limits[name]))
        for name, value in zip(names, solved.values / norms, strict=True)
    }
    moved = full[:, :p] @ np.array([best[name] for name in names])
    return float(np.linalg.norm(full[:, p] - moved)), best


def _factors(
    model: Model, packed: FloatArray, names: Sequence[str], target: Target, first: FirstStage,
    offsets: Sequence[float],
) -> list[FloatArray]:  # fmt: skip
    """Return R of the QR factorisation of [1, derivatives, residual] by sampling offset."""
    factors = []
    with np.errstate(over='ignore', invalid='ignore'):
        y, rows = sensitivities(
            model, packed, names, target.voltage, target.dt, target.frequency, target.start,
            first=first,
        )  # fmt: skip
        for offset in offsets:
            late = samples_late(model, target.dt, offset)
            error = target.measured - target.pick(read(y, target, late))
            columns = read(rows, target, late)[:, target.compared]
            factors.append(triangle(np.vstack([np.ones_like(error), columns, error])))
    return factors
