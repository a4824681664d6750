"""Parameters in which a chain is affine: detection by superposition and exact solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.sensitivities import sensitivities
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import triangle


def linear_parameters(model: Model, free: Sequence[str], amplitude: float) -> tuple[str, ...]:
    """Return the longest leading sequence of unknowns in which the response is jointly affine.

    It is found by superposition on a short test signal and holds for any chain: ``A1, A,
    offset`` of a Bouc-Wen chain (h is homogeneous in A > 0), each weight of a play bank.

    Parameters
    ----------
    model : Model
        Any chain, with defaults and scales that suit the data.
    free : sequence of str
        Unknowns to choose from.
    amplitude : float
        Amplitude of the test signal [V].
    """
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


def solve_linear(
    model: Model,
    targets: Sequence[Target],
    values: Mapping[str, float],
    names: Sequence[str],
) -> dict[str, float]:
    """Return `values` with the unknowns `names` at their least-squares optimum.

    Parameters
    ----------
    model : Model
        A chain that is affine in `names`.
    targets : sequence of Target
        Data.
    values : mapping of str to float
        The other parameters.
    names : sequence of str
        From `linear_parameters`.
    """
    base = {**values, **dict.fromkeys(names, 0.0)}
    packed = model.pack(base, checked=False)
    p = len(names)
    blocks = []
    with np.errstate(over='ignore', invalid='ignore'):
        for target in targets:
            y, rows = sensitivities(
                model, packed, names, target.voltage, target.dt, target.frequency, target.start
            )
            part = np.vstack([rows[:, target.compared], target.measured - target.pick(y)])
            if not np.all(np.isfinite(part)):
                return dict(values)
            if target.own_zero:
                part -= part.mean(axis=1, keepdims=True)
            blocks.append(triangle(target.weight * part))
    full = triangle(np.ascontiguousarray(np.vstack(blocks).T))
    norms = np.linalg.norm(full[:p, :p], axis=0)
    norms[norms == 0.0] = 1.0
    solved = solve_least_squares(full[:p, :p] / norms, full[:p, p], rcond=1e-7)
    if not solved.sound:
        return dict(values)
    best = solved.values / norms
    limits = {q.name: (q.low, q.high) for q in model.parameters}
    best = np.array(
        [np.clip(value, *limits[name]) for name, value in zip(names, best, strict=True)]
    )
    best_values = dict(zip(names, (float(v) for v in best), strict=True))
    return {**values, **best_values}
