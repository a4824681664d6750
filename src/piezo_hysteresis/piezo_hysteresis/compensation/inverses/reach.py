"""Stroke of a model within the voltage limits, and whether a reference is within it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.inverses.inverse_choice import model_gain
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import operating_limits, rate_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models import Model, ModelFile

_SLOW = 20.0  # duration of two periods of a triangle that excites no mode [s]
_MOST_SAMPLES = 400_000
# Tolerance: a model is not exact, and a limited voltage affects only the tips.
_TOLERANCE = 1.1
_LINES = 24  # number of frequencies at which the gain is evaluated
_LOOKED_AT = 1 << 18  # its number of samples


@dataclass(frozen=True)
class Reach:
    """Quasi-static range of the displacement of a model."""

    low: float  # [m]
    high: float  # [m]

    @property
    def middle(self) -> float:
        """Centre of the range [m]."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Largest amplitude [m]."""
        return 0.5 * (self.high - self.low)


def reach_of(model: Model, values: Mapping[str, float], dt: float, limits: Limits) -> Reach:
    """Return the range of the displacement for a slow voltage from limit to limit."""
    # dt [s]
    samples = int(np.clip(_SLOW / dt, 400, _MOST_SAMPLES))
    turn = 2.0 * np.arange(samples) / samples
    way = 2.0 * np.abs(turn - np.floor(turn + 0.5))  # 0 .. 1 .. 0, twice
    voltage = limits.low + (limits.high - limits.low) * way
    with np.errstate(over='ignore', invalid='ignore'):
        moved = model.respond(voltage, model.pack(values), dt)[samples // 2 :]
    return Reach(float(np.min(moved)), float(np.max(moved)))


def usual_reference(model: ModelFile) -> tuple[float, float]:
    """Return mean and amplitude of a reference over half the range of a model [m]."""
    limits = operating_limits(model).limits
    reach = reach_of(model.model, model.values, 1.0 / rate_of(model), limits)
    return reach.middle, 0.5 * reach.half


def require_reachable(
    reference: FloatArray, model: Model, values: Mapping[str, float], dt: float, limits: Limits
) -> None:  # reference [m] (n,)
    """Raise an error for a reference outside the range of the model."""
    low, high = float(np.min(reference)), float(np.max(reference))
    reach = reach_of(model, values, dt, limits)
    if not np.isfinite(reach.half):
        return  # the study reports a divergent model
    offset = abs(0.5 * (low + high) - reach.middle)
    amplitude = 0.5 * (high - low)
    if amplitude + offset <= _TOLERANCE * reach.half:
        return
    helped = amplitude / _amplification(reference, model, values, dt, limits)
    if helped + offset <= _TOLERANCE * reach.half:
        return
    raise CompensationError(
        f'the reference goes from {1e6 * low:.4g} to {1e6 * high:.4g} µm, but between '
        f'{limits.low:g} and {limits.high:g} V the model reaches {1e6 * reach.low:.4g} to '
        f'{1e6 * reach.high:.4g} µm; amplitudes are in m (120 µm is 120e-6)'
    )


def _amplification(
    reference: FloatArray, model: Model, values: Mapping[str, float], dt: float, limits: Limits
) -> float:
    """Return the dynamic amplification of the model at the frequencies of a reference."""
    seen = reference[:_LOOKED_AT] - np.mean(reference[:_LOOKED_AT])
    power = np.cumsum(np.abs(np.fft.rfft(seen * np.hanning(seen.size))) ** 2)
    if not power[-1] > 0.0:
        return 1.0
    highest = float(np.searchsorted(power, 0.99 * power[-1])) / (seen.size * dt)
    gain = model_gain(model, values, dt, 0.5 * (limits.high - limits.low))
    sizes = [abs(gain(float(f))) for f in np.linspace(0.0, highest, _LINES)]
    return max(1.0, max(sizes) / sizes[0]) if sizes[0] > 0.0 else 1.0
