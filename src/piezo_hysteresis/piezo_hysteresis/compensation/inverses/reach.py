"""How far a model goes within the limits of the voltage, and whether a reference lies within."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.inverses.inverse_choice import model_gain
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models import Model

_SLOW = 20.0  # two periods of a triangle that excites no mode [s]
_MOST_SAMPLES = 400_000
# A model is not exact, and a limited voltage costs the tips only.
_TOLERANCE = 1.1
_LINES = 24  # frequencies at which the gain of a reference is looked at
_LOOKED_AT = 1 << 18  # samples of it


@dataclass(frozen=True)
class Reach:
    """Displacements between which a model moves, slowly.

    Attributes
    ----------
    low, high : float
        Extremes [m].
    """

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Where it moves about [m]."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Largest amplitude [m]."""
        return 0.5 * (self.high - self.low)


def reach_of(model: Model, values: Mapping[str, float], dt: float, limits: Limits) -> Reach:
    """Return how far a model goes when the voltage goes slowly from limit to limit.

    Parameters
    ----------
    model, values : Model, mapping of str to float
        The chain and its parameters.
    dt : float
        Sampling interval [s].
    limits : Limits
        Of the voltage.

    Returns
    -------
    Reach
        Not finite where the model diverges.
    """
    samples = int(np.clip(_SLOW / dt, 400, _MOST_SAMPLES))
    turn = 2.0 * np.arange(samples) / samples
    way = 2.0 * np.abs(turn - np.floor(turn + 0.5))  # 0 .. 1 .. 0, twice
    voltage = limits.low + (limits.high - limits.low) * way
    with np.errstate(over='ignore', invalid='ignore'):
        moved = model.respond(voltage, model.pack(values), dt)[samples // 2 :]
    return Reach(float(np.min(moved)), float(np.max(moved)))


def require_reachable(
    reference: FloatArray, model: Model, values: Mapping[str, float], dt: float, limits: Limits
) -> None:
    """Refuse a reference that the model cannot follow whatever the voltage.

    Parameters
    ----------
    reference : ndarray, shape (n,)
        Desired displacement [m].
    model, values, dt, limits
        As in `reach_of`.

    Raises
    ------
    CompensationError
        If it leaves what the model reaches, where its resonance helps too.
    """
    low, high = float(np.min(reference)), float(np.max(reference))
    reach = reach_of(model, values, dt, limits)
    if not np.isfinite(reach.half):
        return  # the study itself shows a model that diverges
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
    """Return how much further than slowly the model goes at the frequencies of a reference."""
    seen = reference[:_LOOKED_AT] - np.mean(reference[:_LOOKED_AT])
    power = np.cumsum(np.abs(np.fft.rfft(seen * np.hanning(seen.size))) ** 2)
    if not power[-1] > 0.0:
        return 1.0
    highest = float(np.searchsorted(power, 0.99 * power[-1])) / (seen.size * dt)
    gain = model_gain(model, values, dt, 0.5 * (limits.high - limits.low))
    sizes = [abs(gain(float(f))) for f in np.linspace(0.0, highest, _LINES)]
    return max(1.0, max(sizes) / sizes[0]) if sizes[0] > 0.0 else 1.0
