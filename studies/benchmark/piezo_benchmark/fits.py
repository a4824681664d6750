"""Least squares by damped Gauss-Newton steps, with the whole Jacobian from one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_benchmark.worlds import PLAYS, Array, Effects, Scale, Values, responses

#: The parameters of each baseline; ``offset`` is the zero of a record and is projected out.
NAMES = {
    'bouc_wen': ('gain', 'loop', 'beta', 'gamma'),
    'bouc_wen_mode': ('gain', 'loop', 'beta', 'gamma', 'frequency', 'damping'),
    'play_bank': ('w0', *(f'w{j}' for j in range(1, PLAYS.size + 1))),
}
Key = tuple[str, str]  # effect ('' is the baseline) and parameter


@dataclass(frozen=True)
class Fit:
    """What least squares found.

    Attributes
    ----------
    values, effects : parameters in SI units
    deviations : standard deviation of each free parameter, for white residuals
    residual : (samples, records) [m], each record without its mean
    jacobian : (samples * records, parameters) of the kept samples, in units of `steps`
    """

    values: dict[str, float]
    effects: dict[str, dict[str, float]]
    deviations: dict[Key, float]
    residual: Array
    jacobian: Array

    @property
    def rss(self) -> float:
        """Sum of squares [m^2]."""
        return float(np.sum(self.residual**2))


def centred(signal: Array, warm_up: int) -> Array:
    """Return the kept samples, each record without its mean."""
    kept = signal[warm_up:]
    return np.asarray(kept - kept.mean(0))


def step_of(key: Key, value: float, scale: Scale) -> float:
    """Return a finite-difference step that changes the displacement by about 1e-5 strokes."""
    effect, name = key
    if not effect:
        per_volt = scale.metres / scale.volts
        return {
            'gain': 1e-4 * per_volt,
            'loop': 1e-4 * per_volt,
            'beta': 1e-4 / scale.volts,
            'gamma': 1e-4 / scale.volts,
            'frequency': 1e-4 * abs(value),
            'damping': 1e-4,
        }.get(name, 1e-4 * per_volt)
    if name in ('delay', 'lag_time'):
        return 1e-3 * scale.dt
    if name in ('frequency', 'time'):
        return 1e-5 * abs(value) if effect == 'tone' else 1e-3 * abs(value)
    return 1e-4


def _bounded(
    world: str, values: dict[str, float], effects: dict[str, dict[str, float]], scale: Scale
) -> None:
    if world.startswith('bouc_wen'):
        values['beta'] = float(np.clip(values['beta'], 1e-3 / scale.volts, 50.0 / scale.volts))
        most = 0.98 * values['beta']
        values['gamma'] = float(np.clip(values['gamma'], -most, most))
    nyquist = 0.5 / scale.dt
    for holder in (values, *effects.values()):
        if 'frequency' in holder:
            holder['frequency'] = float(np.clip(holder['frequency'], 0.1, 0.9 * nyquist))
        if 'damping' in holder:
            holder['damping'] = float(np.clip(holder['damping'], 1e-3, 0.9))
        if 'time' in holder:
            holder['time'] = float(np.clip(holder['time'], 2 * scale.dt, 3.0 * scale.span))
        for name in ('delay', 'lag_time'):
            if name in holder:
                holder[name] = float(np.clip(holder[name], 0.0, 30 * scale.dt))
        for name in ('bend', 'width'):
            if name in holder:
                holder[name] = float(np.clip(holder[name], 1e-4, 3.0))


def changed(
    values: Values, effects: Effects, keys: Sequence[Key], amounts: Sequence[float]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return values and effects with amounts added to some of them."""
    new = dict(values), {name: dict(e) for name, e in effects.items()}
    for (effect, name), amount in zip(keys, amounts, strict=True):
        holder = new[1][effect] if effect else new[0]
        holder[name] += float(amount)
    return new


def beside(
    world: str,
    voltage: Array,
    scale: Scale,
    jobs: Sequence[tuple[Values, Effects]],
    before: Array | None,
) -> list[Array]:
    """Return responses on records, and next to them those without effects on a reference."""
    found = responses(world, voltage, scale, jobs)
    if before is None:
        return found
    plain = responses(world, before, scale, [(values, {}) for values, _ in jobs])
    return [np.concatenate(pair, 1) for pair in zip(found, plain, strict=True)]


def linearised(
    world: str,
    voltage: Array,
    scale: Scale,
    values: Values,
    effects: Effects,
    keys: Sequence[Key],
    before: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Return the response (samples, records) [m], its Jacobian and the steps of its parameters.

    The Jacobian (parameters, samples, records) is in metres per step. The voltage `before`
    [V] of a reference adds its records as columns.
    """
    steps = np.array([step_of(k, (effects[k[0]] if k[0] else values)[k[1]], scale) for k in keys])
    jobs = [(values, effects)]
    for place, step in enumerate(steps):
        jobs.append(changed(values, effects, [keys[place]], [step]))
    found = beside(world, voltage, scale, jobs, before)
    return found[0], np.array([y - found[0] for y in found[1:]]), steps


def fitted(
    world: str,
    voltage: Array,
    measured: Array,
    scale: Scale,
    warm_up: int,
    values: Values,
    effects: Effects | None = None,
    iterations: int = 8,
    keys: Sequence[Key] | None = None,
    before: Array | None = None,
) -> Fit:
    """Fit a baseline, and effects in addition, to records in free run.

    Parameters
    ----------
    world : str
        Name of the baseline.
    voltage, measured : (samples, records) [V], [m]
    scale : Scale
    warm_up : int
        Samples that are simulated and not compared.
    values, effects : where the fit begins
    iterations : int
        Most steps.
    keys : sequence of (effect, parameter)
        What is free; everything by default.
    before : (samples, records) [V]
        Voltage of a reference, on which no effect acts; its displacements are then the last
        columns of `measured`.
    """
    now = dict(values), {name: dict(e) for name, e in (effects or {}).items()}
    if keys is None:
        keys = [('', name) for name in NAMES[world]]
        keys += [(effect, name) for effect, e in now[1].items() for name in e]
    target = centred(measured, warm_up)
    damping, after = 1e-6, np.inf
    for _ in range(iterations):
        y, slopes, steps = linearised(world, voltage, scale, *now, keys, before)
        residual = target - centred(y, warm_up)
        matrix = np.array([centred(s, warm_up).ravel() for s in slopes]).T
        size = np.sqrt(np.sum(matrix**2, 0)) + 1e-30
        scaled = matrix / size
        rss, moved = float(np.sum(residual**2)), False
        gram, pull = scaled.T @ scaled, scaled.T @ residual.ravel()
        for _ in range(4):
            move = np.linalg.solve(gram + damping * np.eye(len(keys)), pull) / size
            trial = changed(*now, keys, move * steps)
            _bounded(world, *trial, scale)
            answer = beside(world, voltage, scale, [trial], before)[0]
            after = float(np.sum((target - centred(answer, warm_up)) ** 2))
            if after < rss:
                now, moved, damping = trial, True, damping / 10
                break
            damping = min(damping * 30, 1e3)
        if not moved or rss - after < 1e-5 * rss:
            break
    y, slopes, steps = linearised(world, voltage, scale, *now, keys, before)
    residual = target - centred(y, warm_up)
    matrix = np.array([centred(s, warm_up).ravel() for s in slopes]).T
    size = np.sqrt(np.sum(matrix**2, 0)) + 1e-30
    inverse = np.linalg.pinv((matrix / size).T @ (matrix / size), rcond=1e-12)
    variance = float(np.sum(residual**2)) / max(residual.size - len(keys), 1)
    sd = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance) / size * steps
    deviations = {key: float(d) for key, d in zip(keys, sd, strict=True)}
    return Fit(now[0], now[1], deviations, residual, matrix)
