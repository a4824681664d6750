"""Common parts of entries: the effects of the list as columns next to the baseline's tangent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_benchmark.effects import EFFECTS
from piezo_benchmark.entries.calibrated import Statement, kind_of
from piezo_benchmark.fits import NAMES, Fit, beside, centred, fitted, linearised
from piezo_benchmark.tasks import NONE, UNKNOWN, Task
from piezo_benchmark.worlds import PLAYS, Array, plays

RIDGE = 1e-4  # of the correction of a baseline, over the number of samples


@dataclass(frozen=True)
class Signature:
    """What one effect adds to the free run of a baseline.

    Attributes
    ----------
    name : str
    parameters : dict of str to float
        With which it was computed.
    training : (samples, records) [m]
        Reference records follow those of the task, with zeros.
    """

    name: str
    parameters: dict[str, float]
    training: Array


def voltage_before(task: Task) -> Array | None:
    """Return the voltages of the reference [V], if there is one."""
    return None if task.reference is None else task.reference.voltage


def all_measured(task: Task) -> Array:
    """Return the displacements of the records and, after them, of the reference [m]."""
    if task.reference is None or task.reference.displacement is None:
        return task.measured
    return np.concatenate([task.measured, task.reference.displacement], 1)


@dataclass(frozen=True)
class Corrected:
    """A task without the error that its baseline already has on the reference.

    Attributes
    ----------
    task : Task
    held_out : (samples, held-out records) [m]
        The correction on the held-out voltages, which a prediction adds again.
    error : float
        What the correction misses on a record that it has not seen, rms [m].
    """

    task: Task
    held_out: Array
    error: float


def corrected(task: Task) -> Corrected:
    """Subtract the known error of the baseline; change nothing where there is no reference.

    The error on the reference is regressed on the voltage, on plays of it, and on their squares
    and cubes, by ridge regression. Its own error is the median of those on a quarter of the
    reference by the other three.
    """
    before = task.reference
    if before is None or before.displacement is None:
        return Corrected(task, np.zeros_like(task.held_out.free_run), 0.0)
    columns = _columns(task, before.voltage)
    error = centred(before.displacement - before.free_run, task.warm_up).T.ravel()
    kept = np.array([centred(c, task.warm_up).T.ravel() for c in columns]).T
    weights = _ridge(kept, error)
    quarters = np.array_split(np.arange(error.size), 4)
    missed = [
        np.std(error[part] - kept[part] @ _ridge(np.delete(kept, part, 0), np.delete(error, part)))
        for part in quarters
    ]

    def correction(voltage: Array) -> Array:
        return np.asarray(np.tensordot(weights, _columns(task, voltage), 1))

    records = task.measured - correction(task.records.voltage)
    reference = before.displacement - correction(before.voltage)
    changed = replace(
        task,
        records=replace(task.records, displacement=records),
        reference=replace(before, displacement=reference),
    )
    return Corrected(changed, correction(task.held_out.voltage), float(np.median(missed)))


def _ridge(columns: Array, target: Array) -> Array:
    size = np.sqrt(np.mean(columns**2, 0)) + 1e-12
    scaled = columns / size
    gram = scaled.T @ scaled + RIDGE * len(columns) * np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(gram, scaled.T @ target) / size)


def _columns(task: Task, voltage: Array) -> Array:
    volts = task.scale.volts
    bank = plays(voltage, PLAYS * volts, task.scale.moving)
    linear = np.moveaxis(np.concatenate([voltage[:, :, None], bank], 2), 2, 0) / volts
    return np.concatenate([linear, linear**2, linear**3])


def base_fit(task: Task) -> Fit:
    """Fit the baseline alone to records and reference."""
    values = {k: v for k, v in task.baseline.values.items() if k != 'offset'}
    return fitted(
        task.baseline.name, task.records.voltage, all_measured(task), task.scale, task.warm_up,
        values, before=voltage_before(task),
    )  # fmt: skip


def tones(task: Task, residual: Array, count: int = 3) -> list[dict[str, float]]:
    """Return the strongest tones of a residual, as effects of the list."""
    records = task.records.voltage.shape[1]
    left = residual[:, :records] * np.hanning(residual.shape[0])[:, None]
    padded = 4 * left.shape[0]
    power = np.sum(np.abs(np.fft.rfft(left, padded, axis=0)) ** 2, 1)
    frequency = np.fft.rfftfreq(padded, task.scale.dt)
    power[frequency < 4.0 / task.scale.span] = 0.0
    found = []
    for _ in range(count):
        at = int(np.argmax(power))
        found.append({'sine': 0.01, 'cosine': 0.01, 'frequency': float(frequency[at])})
        power[max(at - 12, 0) : at + 13] = 0.0
    return found


def signatures(task: Task, fit: Fit) -> list[Signature]:
    """Return a column for every start of every effect, at the values and effects of a fit."""
    tried = [(name, p) for name, e in EFFECTS.items() for p in e.starts(task.scale)]
    for p in tones(task, fit.residual):
        tried += [('tone', {**p, 'cosine': 0.0}), ('tone', {**p, 'sine': 0.0})]
    tried = [(name, p) for name, p in tried if name not in fit.effects]
    jobs = [(fit.values, fit.effects)]
    jobs += [(fit.values, {**fit.effects, name: p}) for name, p in tried]
    found = beside(
        task.baseline.name, task.records.voltage, task.scale, jobs, voltage_before(task)
    )
    return [
        Signature(name, p, centred(y - found[0], task.warm_up))
        for (name, p), y in zip(tried, found[1:], strict=True)
    ]


def held_out_run(
    task: Task, values: dict[str, float], effects: dict[str, dict[str, float]]
) -> Array:
    """Return the free run of a baseline with effects on the held-out voltages [m]."""
    return beside(
        task.baseline.name, task.held_out.voltage, task.scale, [(values, effects)], None
    )[0]


def basis(matrix: Array) -> Array:
    """Return an orthonormal basis of columns."""
    scaled = matrix / (np.sqrt(np.sum(matrix**2, 0)) + 1e-30)
    left, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-6 * sizes[0]])


def free_names(task: Task) -> int:
    """Return how many parameters the baseline has."""
    return len(NAMES[task.baseline.name])


def memory(residual: Array) -> float:
    """Return the share of samples that are independent, by the correlation of neighbours."""
    rho = float(np.sum(residual[1:] * residual[:-1]) / (np.sum(residual**2) + 1e-300))
    rho = min(max(rho, 0.0), 0.999)
    return (1.0 - rho) / (1.0 + rho)


def remains(residual: Array) -> bool:
    """Return whether neighbouring samples of a residual are correlated: it is not white noise."""
    return memory(residual) < 0.9


def linear_prediction(
    task: Task, fit: Fit, parts: list[Signature], weights: Array, slopes: Array
) -> Array:
    """Return the held-out prediction [m] of a linear combination of signatures.

    Parameters
    ----------
    parts : list of Signature
    weights : (signatures,)
    slopes : (baseline parameters,)
        What the parameters of the baseline move, in steps of `linearised`.
    """
    world, voltage, scale = task.baseline.name, task.held_out.voltage, task.scale
    keys = [('', name) for name in NAMES[world]]
    base, columns, _ = linearised(world, voltage, scale, fit.values, fit.effects, keys)
    used = [(s, float(w)) for s, w in zip(parts, weights, strict=True) if w]
    jobs = [(fit.values, {**fit.effects, s.name: s.parameters}) for s, _ in used]
    found = beside(world, voltage, scale, jobs, None) if jobs else []
    moved = base + np.tensordot(slopes, columns, 1)
    return np.asarray(moved + sum(w * (y - base) for (_, w), y in zip(used, found, strict=True)))


@dataclass(frozen=True)
class Library:
    """Signatures of all effects as regressors, the baseline's tangent taken out of them.

    Attributes
    ----------
    known : Corrected
        The task without the known error of the baseline.
    target : (samples,)
        Residual of the fitted baseline, in its rms.
    columns : (samples, signatures)
        Unit rms.
    sizes : (signatures,)
        What one unit of a column is, in signatures, times the rms of the residual.
    """

    known: Corrected
    fit: Fit
    parts: list[Signature]
    target: Array
    columns: Array
    sizes: Array

    def prediction(self, weights: Array) -> Array:
        """Return the held-out prediction of weights of the columns [m]."""
        real = weights * self.sizes
        said = sum(
            (w * s.training.ravel() for w, s in zip(real, self.parts, strict=True) if w),
            np.zeros(self.target.size),
        )
        rest = self.fit.residual.ravel() - said
        slopes = np.asarray(np.linalg.lstsq(self.fit.jacobian, rest, rcond=1e-8)[0], np.float64)
        run = linear_prediction(self.known.task, self.fit, self.parts, real, slopes)
        return run + self.known.held_out

    def named(self, weights: Array) -> tuple[str, list[str]]:
        """Return which outcome a sparse combination of the columns states, and its names by worth.

        Columns count for the name of the effect they were computed with. The name without which
        most remains is the first; a second one joins it if it takes a tenth of that. Less than
        5 % explained is `none`, less than 30 % is `unknown`.
        """
        names = {s.name for s, w in zip(self.parts, weights, strict=True) if w}
        total = float(self.target @ self.target)
        whole = self.target - self.columns @ weights
        explained = 1.0 - float(whole @ whole) / total
        worth = {}
        for name in names:
            kept = np.array([s.name == name for s in self.parts])
            alone = whole + self.columns[:, kept] @ weights[kept]
            worth[name] = float(alone @ alone - whole @ whole)
        order = sorted(worth, key=lambda name: -worth[name])
        if not order or explained < 0.05:
            return NONE, order
        if explained < 0.3:
            return UNKNOWN, order
        if len(order) > 1 and worth[order[1]] > 0.1 * worth[order[0]]:
            return '+'.join(sorted(order[:2])), order
        return order[0], order

    def statement(self, weights: Array, resampled: Sequence[Array] = ()) -> Statement:
        """Return what a combination of the columns states; names of the others are possible.

        Outcomes of `resampled` combinations, if there are any, count by their frequency.
        """
        outcome, order = self.named(weights)
        found = [self.named(each) for each in resampled] or [(outcome, order)]
        stated: dict[str, float] = {}
        others = dict.fromkeys(order, 1.0)
        for each, names in found:
            stated[each] = stated.get(each, 0.0) + 1.0 / len(found)
            for name in names:
                others.setdefault(name, 0.0)
                others[name] += 1.0 / len(found)
        whole = self.target - self.columns @ weights
        left = remains(whole.reshape(self.fit.residual.shape))
        return Statement(
            kind_of(outcome, left, self.known.task), stated, others, self.prediction(weights)
        )


def library(task: Task) -> Library:
    """Return the regressors of a task."""
    known = corrected(task)
    task = known.task
    fit = base_fit(task)
    q = basis(fit.jacobian)
    r = fit.residual.ravel()
    rms = float(np.sqrt(np.mean(r**2)))
    parts, columns, sizes = [], [], []
    for part in signatures(task, fit):
        column = part.training.ravel()
        column = column - q @ (q.T @ column)
        size = float(np.sqrt(np.mean(column**2)))
        if size > 1e-9 * task.scale.metres:
            parts.append(part)
            columns.append(column / size)
            sizes.append(rms / size)
    return Library(known, fit, parts, r / rms, np.array(columns).T, np.array(sizes))
