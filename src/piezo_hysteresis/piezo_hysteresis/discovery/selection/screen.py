"""Screening of candidates before any fit, and moves to the optimum of their score.

Every candidate is simulated once per starting point. The change of the response is fitted to the
residual linearly, together with the sensitivities of the model's own parameters. The explained
share is an upper bound on the effect near its starting values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Slot
from piezo_hysteresis.blocks.effect import Residual
from piezo_hysteresis.blocks.transport_delay import in_ticks
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    bounds_of,
    effect_of,
    errors_of,
    evaluated_on,
    nudged,
)
from piezo_hysteresis.discovery.selection.residual_model import Expectation
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import StageCache, differentiated, simulated
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.models import Candidate, Model
from piezo_hysteresis.models.effects import is_never_reached
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import inner, orthonormal, projected_out

# Relative norm of a projected sensitivity below which it is linearly dependent on the others.
_DEPENDENT = 1e-7
# Number of records, those with the largest residual, from which starting values are estimated.
_GUESSES = 3
# Number of parameters from which an effect is also scored by small changes of all of them.
_MANY = 5
# Fractions of a starting value at which a candidate is scored, as effects may be nonlinear.
_STEPS = (1.0, 0.2)
# Relative difference of scores below which an effect counts as linear in its size.
_EQUAL = 1e-6
# Relative difference below which two starting points count as equal.
_ALIKE = 0.15


@dataclass(frozen=True)
class ScreeningScore:
    """Screening score of one candidate."""

    candidate: Candidate  # the model with the effect
    starts: tuple[dict[str, float], ...]  # starting values of all parameters, the best score first
    explained: float  # share of the squared residual that the best starting point explains, 0..1


def _differ(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Return whether two starting points differ by more than the steps of one fit."""
    return any(abs(one[k] - other[k]) > _ALIKE * max(abs(one[k]), abs(other[k])) for k in one)


class Screen:
    """The residual of a model with the sensitivities of its own parameters projected out."""

    def __init__(
        self,
        fit: CandidateFit,
        views: Sequence[FitData],
        free: Sequence[str] | None = None,
        workers: int = 1,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._fit, self._stopped = fit, stopped
        self._free = fit.model.free_names if free is None else tuple(free)
        self._views = views
        packed, late = fit.model.pack(fit.values), fit.sampling_offset
        self._known = StageCache(fit.model, packed, views)
        self._simulated = [simulated(fit.model, packed, v, late, self._known) for v in views]
        self._errors = errors_of(fit, views, self._known)
        self._residual = np.concatenate(self._errors)
        self._basis = self._own_basis(workers)
        self._left = self._project(self._residual)

    def _own_basis(self, workers: int) -> FloatArray:
        found = of_each(self._difference, self._free, workers)
        columns = [column for column in found if column is not None]
        if not columns:
            return np.zeros((0, self._residual.size))
        basis = orthonormal(np.array(columns), _DEPENDENT)
        return basis[np.any(basis != 0.0, axis=1)]

    def _difference(self, name: str) -> FloatArray | None:
        try:
            moved = self._flat(nudged(self._fit, name))
        except PiezoError:
            return None
        size = float(np.linalg.norm(moved))
        return moved / size if np.isfinite(size) and size > 0 else None

    def _flat(self, values: dict[str, float]) -> FloatArray:
        errors = errors_of(self._with(self._fit.model, values), self._views, self._known)
        return np.asarray(self._residual - np.concatenate(errors))

    def _with(self, model: Model, values: dict[str, float]) -> ModelSpec:
        return ModelSpec(model, values, sampling_offset=self._fit.sampling_offset)

    def _project(self, vector: FloatArray) -> FloatArray:
        return projected_out(vector, self._basis)[1]

    def score(self, candidate: Candidate) -> ScreeningScore:
        """Return the screening score of `candidate`, with its starting points sorted by it."""
        before = self._fit.values
        found: list[tuple[float, dict[str, float]]] = []
        steps: Sequence[float] = _STEPS
        for start in (*self._guesses(candidate), *candidate.starts):
            if found and self._stopped():
                break
            values = candidate.values(before, start)
            share, chosen, linear = self._best_step(candidate, values, steps)
            # an effect that is linear in its size is linear from every starting point
            steps = steps[:1] if linear else steps
            found.append((max(share, self._about(candidate, values)), chosen))
        found.sort(key=lambda each: -each[0])
        apart: list[dict[str, float]] = []
        for _, start in found:
            if all(_differ(start, other) for other in apart):
                apart.append(start)
        return ScreeningScore(candidate, tuple(apart), found[0][0])

    def _guesses(self, candidate: Candidate) -> list[dict[str, float]]:
        """Return starting values estimated from the largest residuals."""
        if candidate.effect.guess is None:
            return []
        sizes = [float(np.std(error)) for error in self._errors]
        block = candidate.effect.block
        zero = sum(self._fit.values[name] for name in self._fit.model.zero_names)
        # an effect that depends on time is most visible in records with little motion
        count = len(sizes) if block is not None and block.is_tone else _GUESSES
        guesses: list[dict[str, float]] = []
        for place in np.argsort(sizes)[::-1][:count]:
            view, y = self._views[place], self._simulated[place]
            seen = Residual(
                view.voltage[view.first :],
                y[view.first :] - zero,
                self._errors[place],
                view.dt,
                view.frequency,
                view.start + view.first * view.dt + self._fit.sampling_offset,
                self._fit.values,
            )
            guesses += [each for each in candidate.guessed(seen) if each not in guesses]
        return guesses

    def _best_step(
        self, candidate: Candidate, values: dict[str, float], steps: Sequence[float]
    ) -> tuple[float, dict[str, float], bool]:
        """Return the best explained share, its starting values and the linearity of the effect."""
        shares: list[float] = []
        best, chosen = 0.0, values
        neutral = candidate.neutral
        for step in steps:
            if shares and self._stopped():
                break
            tried = {
                name: neutral[name] + step * (value - neutral[name])
                if name in neutral and not is_never_reached(neutral[name])
                else value
                for name, value in values.items()
            }
            shares.append(self._explained(candidate, tried))
            if shares[-1] > (1.0 + _EQUAL) * best:
                best, chosen = shares[-1], tried
        return best, chosen, best > 0.0 and min(shares) >= (1.0 - _EQUAL) * best

    def _about(self, candidate: Candidate, values: dict[str, float]) -> float:
        """Return the share explained by small changes of all new parameters at a starting point.

        The step towards a starting point is not meaningful for effects with many parameters, such
        as a bank of plays, whose starting point is arbitrary. It is zero if the starting point
        equals the present model.
        """
        if candidate.effect.refits:
            if any(values[name] != self._fit.values[name] for name in candidate.added):
                return 0.0
        elif len(candidate.added) < _MANY:
            return 0.0
        return self.nearby(candidate, values)

    def nearby(self, candidate: Candidate, values: dict[str, float]) -> float:
        """Return the share explained by small changes of all new parameters about some values.

        The response of the candidate at these values must equal that of the present model.
        """
        rows = []
        try:
            packed = candidate.model.pack(values)
        except PiezoError:
            return 0.0
        for view in self._views:
            if self._stopped():
                return 0.0
            late = self._fit.sampling_offset
            for part in differentiated(candidate.model, packed, candidate.added, view, late):
                _, here = view.compared_in(part.first, part.first + part.slope.size)
                rows.append(part.rows[:, here])
        columns = np.hstack(rows)
        if not np.all(np.isfinite(columns)):
            return 0.0
        own = np.array([self._project(column) for column in columns])
        basis = orthonormal(own, _DEPENDENT)
        total = sum(inner(row, self._left) ** 2 for row in basis)
        return total / max(inner(self._residual, self._residual), 1e-300)

    def _explained(self, candidate: Candidate, values: dict[str, float]) -> float:
        try:
            errors = errors_of(self._with(candidate.model, values), self._views, self._known)
        except PiezoError:
            return 0.0
        moved = self._residual - np.concatenate(errors)
        if not np.all(np.isfinite(moved)):
            return 0.0
        column = self._project(moved)
        size = inner(column, column)
        if size <= 1e-18 * inner(moved, moved):
            return 0.0
        gain = inner(column, self._left)
        return gain**2 / size / max(inner(self._residual, self._residual), 1e-300)


# Share of a record, 1 / _PAD, by which it is extended, because the transform is periodic.
_PAD = 8

# Frequency response by frequency [Hz].
_Response = Callable[[FloatArray], ComplexArray]


def with_delayed_discrepancy(
    spec: ModelSpec,
    errors: Sequence[FloatArray],  # [m]
    views: Sequence[FitData],
    expected: Sequence[Expectation],
    late: float,  # [s]
) -> tuple[FloatArray, ...]:
    """Return residuals beyond the known discrepancy as the added effects pass it on."""
    responses = _responses(spec, views[0].dt, late) if views else []
    if not responses:
        return tuple(errors)
    return tuple(
        error + x.repeated - _passed(x.repeated, view.dt * view.stride, responses)
        for error, view, x in zip(errors, views, expected, strict=True)
    )


def _passed(signal: FloatArray, dt: float, responses: Sequence[_Response]) -> FloatArray:
    """Return a signal after linear systems; its mean stays."""
    if not np.any(signal):
        return signal
    pad = signal.size // _PAD
    held = np.concatenate([np.full(pad, signal[0]), signal])
    frequency = np.asarray(np.fft.rfftfreq(held.size, dt), np.float64)
    spectrum = np.fft.rfft(held)
    for response in responses:
        spectrum *= response(frequency)
    return np.asarray(np.fft.irfft(spectrum, held.size)[pad:], np.float64)


def _responses(spec: ModelSpec, dt: float, late: float) -> list[_Response]:
    """Return the frequency responses of the added delays and lags."""
    found: list[_Response] = []
    for added in spec.added:
        block = effect_of(added).block
        if block is None or block.slot not in (Slot.INPUT, Slot.SENSOR):
            continue
        own = np.array([spec.values[added.names[each.name]] for each in block.parameters])
        if block.between is InterSample.DELAY:
            name = added.names[block.parameters[0].name]
            by_ticks = name in delays_by_ticks(spec.model)
            found.append(_delay(whole_delay(spec, name, dt, late) if by_ticks else float(own[0])))
        elif block.between is InterSample.LINEAR and _is_low_pass(block, own):
            found.append(_low_pass(block, own))
    return found


def whole_delay(spec: ModelSpec, name: str, dt: float, late: float) -> float:
    """Return a delay that moves a held voltage by ticks of `dt` [s], with its fraction [s].

    The fraction is a sampling offset from that of the baseline, `late` [s]: samples that are read
    earlier show a response that comes later.
    """
    return in_ticks(spec.values[name], dt)[0] * dt - (spec.sampling_offset - late)


def _delay(time: float) -> _Response:
    return lambda frequency: np.exp(-2j * np.pi * frequency * time)


def _is_low_pass(block: Block, own: FloatArray) -> bool:
    return block.system is not None and block.system(own).a.shape == (1, 1)


def _low_pass(block: Block, own: FloatArray) -> _Response:
    assert block.system is not None
    a, b, c, d = block.system(own)
    return lambda frequency: d + c[0] * b[0] / (2j * np.pi * frequency - a[0, 0])


# Steps, and the shares of a step that are tried until one improves the score.
_ROUNDS = 3
_SHARES = (1.0, 0.5, 0.2, 0.05)
# Increase of the score that is worth another step [nats].
_WORTH = 0.05
# A model with more parameters is not moved: each needs a simulation per step.
_MOST = 12
# Relative singular value below which a direction is not determined.
_SINGULAR = 1e-6
# Change of a delay for a difference, in ticks.
_PART = 0.1


class ScoreAscent:
    """Moves a fit towards the optimum of its score."""

    def __init__(
        self,
        views: Sequence[FitData],
        expected: Sequence[Expectation],
        score: Callable[[CandidateFit], float],
        residuals: Callable[[CandidateFit], Sequence[FloatArray]],  # [m]
        late: float,  # [s]
    ) -> None:
        self._views, self._expected = views, expected
        self._score, self._residuals = score, residuals
        self._late, self._dt = late, views[0].dt

    def __call__(self, fit: CandidateFit, free: Sequence[str]) -> CandidateFit:
        """Return the fit with the best score that some steps reach, or `fit` itself."""
        if not free or len(free) > _MOST:
            return fit
        best = self._score(fit)
        for _ in range(_ROUNDS):
            step, predicted = self._step(fit, free)
            if predicted < _WORTH:
                break
            moved = (self._moved(fit, free, share * step) for share in _SHARES)
            scored = ((each, self._score(each)) for each in moved)
            better = next((pair for pair in scored if pair[1] < best - _WORTH), None)
            if better is None:
                break
            fit, best = better
        return fit

    def _moved(self, fit: CandidateFit, free: Sequence[str], step: FloatArray) -> CandidateFit:
        """Return the fit after a step, within the bounds; the same fit if it is invalid there."""
        spec = self._spec_at(fit, free, self._point(fit, free) + step)
        try:
            return replace(evaluated_on(spec, self._views), fitted=fit.fitted)
        except PiezoError:
            return fit

    def _step(self, fit: CandidateFit, free: Sequence[str]) -> tuple[FloatArray, float]:
        """Return the Gauss-Newton step, with the weights of the present residual, and its gain.

        The gain is that of the score to first order [nats].
        """
        errors = self._residuals(fit)
        whiten = [x.whitening(e) for x, e in zip(self._expected, errors, strict=True)]
        columns, sizes = [], []
        for k in range(len(free)):
            moved, size = self._difference(fit, free, k)
            changes = zip(whiten, errors, moved, strict=True)
            column = np.concatenate([w(before - after) for w, before, after in changes])
            known = bool(np.all(np.isfinite(column))) and size != 0.0
            columns.append(column if known else np.zeros_like(column))
            sizes.append(size if known else 0.0)
        residual = np.concatenate([w(e) for w, e in zip(whiten, errors, strict=True)])
        norms = np.linalg.norm(columns, axis=1)
        norms = np.where(norms > 0.0, norms, 1.0)
        rows = np.array(columns) / norms[:, None]
        found = solve_least_squares(rows.T, residual, _SINGULAR).values
        left = residual - found @ rows
        return found / norms * sizes, inner(residual, residual) - inner(left, left)

    def _difference(
        self, fit: CandidateFit, free: Sequence[str], k: int
    ) -> tuple[Sequence[FloatArray], float]:
        """Return the residuals after a small change of one parameter, and the change."""
        name = free[k]
        if k in self._delays(fit, free):
            change = _PART * self._dt
        else:
            change = nudged(fit, name)[name] - fit.values[name]
        point = self._point(fit, free)
        point[k] += change
        try:
            moved = evaluated_on(self._spec_at(fit, free, point), self._views)
        except PiezoError:
            return fit.errors, 0.0
        return self._residuals(moved), change

    # A chain without inertia shows a delay of a held voltage at whole ticks only. The rest of it
    # is a sampling offset, see `whole_delay`.

    def _point(self, fit: CandidateFit, free: Sequence[str]) -> FloatArray:
        point = np.array([fit.values[name] for name in free])
        for k in self._delays(fit, free):
            point[k] = whole_delay(fit, free[k], self._dt, self._late)
        return point

    def _spec_at(self, fit: CandidateFit, free: Sequence[str], point: FloatArray) -> ModelSpec:
        bounds = bounds_of(fit.model, self._views)
        low, high = np.array([bounds[name] for name in free]).T
        values = dict(zip(free, np.clip(point, low, high).tolist(), strict=True))
        offset = fit.sampling_offset
        for k in self._delays(fit, free):
            total = values[free[k]]
            values[free[k]] = self._dt * round(total / self._dt)
            offset = self._late + values[free[k]] - total
        return replace(fit, values={**fit.values, **values}, sampling_offset=offset)

    def _delays(self, fit: CandidateFit, free: Sequence[str]) -> list[int]:
        held = delays_by_ticks(fit.model)
        return [k for k, name in enumerate(free) if name in held]
