"""Gauss-Newton steps on the score of a fixed baseline.

A fit minimises the plain sum of squares. The score weighs each harmonic and octave by its expected
power, so a large known discrepancy, or the remainder of an initial condition, moves the optimum of
the plain sum away from that of the score.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.blocks.base import Between, Block, Slot
from piezo_hysteresis.blocks.transport_delay import in_ticks
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    bounds_of,
    effect_of,
    evaluated_on,
    nudged,
)
from piezo_hysteresis.discovery.selection.residual_model import Expectation
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import inner

# Share of a record, 1 / _PAD, by which it is extended, because the transform is periodic.
_PAD = 8

# Frequency response by frequency [Hz].
_Response = Callable[[FloatArray], ComplexArray]


def with_delayed_discrepancy(
    spec: ModelSpec,
    errors: Sequence[FloatArray],  # [m]
    views: Sequence[Target],
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
        if block.between is Between.DELAY:
            name = added.names[block.parameters[0].name]
            by_ticks = name in delays_by_ticks(spec.model)
            found.append(_delay(whole_delay(spec, name, dt, late) if by_ticks else float(own[0])))
        elif block.between is Between.LINEAR and _is_low_pass(block, own):
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
_STEPS = 3
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
        views: Sequence[Target],
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
        for _ in range(_STEPS):
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
