"""What an experiment may ask of an actuator, as its user says."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import inf, isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.ranges import range_refusal
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile

# Rounding of commands that is no breach of a limit.
_ROUNDING = 1e-9


class InvestigationError(PiezoError):
    """An investigation cannot be done as it was asked for."""


@dataclass(frozen=True)
class ExperimentLimits:
    """What no experiment may exceed.

    Attributes
    ----------
    low, high : float
        Range of the commanded voltage [V]; 0 V, where the actuator rests, lies within.
    slew : float
        Largest change of the command [V/s].
    frequency : float
        Highest frequency of a drive [Hz].
    stroke : float
        Largest range of the displacement that the model in use predicts [m].
    heat : float
        Largest mean of frequency times amplitude squared over an experiment [V^2 Hz]: losses in
        the actuator and its amplifier grow with it.

    Raises
    ------
    InvestigationError
        If they leave nothing to do.
    """

    low: float
    high: float
    slew: float = inf
    frequency: float = 100.0
    stroke: float = inf
    heat: float = inf

    def __post_init__(self) -> None:
        if reason := range_refusal(self.low, self.high):
            raise InvestigationError(reason)
        if not self.low <= 0.0 <= self.high:
            raise InvestigationError(
                f'the voltage limits {self.low:g} .. {self.high:g} V exclude 0 V, where the '
                'actuator rests: include it'
            )
        for name in ('slew', 'frequency', 'stroke', 'heat'):
            if not getattr(self, name) > 0.0:
                raise InvestigationError(f'the limit {name} must be above 0')

    @property
    def middle(self) -> float:
        """Voltage about which experiments swing [V]."""
        return 0.5 * (self.low + self.high)

    @property
    def amplitude(self) -> float:
        """Largest amplitude about the middle [V]."""
        return 0.5 * (self.high - self.low)

    def refusal(self, voltage: FloatArray, dt: float) -> str:
        """Return which limit commands break, empty where they keep all but that of the stroke.

        Parameters
        ----------
        voltage : ndarray, shape (n,)
            Commands, one per tick; before the first and after the last stands 0 V.
        dt : float
            Time between two ticks [s].
        """
        slack = _ROUNDING * max(1.0, self.high - self.low)
        if float(voltage.min()) < self.low - slack or float(voltage.max()) > self.high + slack:
            return 'voltage'
        if fastest(voltage, dt) > self.slew * (1.0 + _ROUNDING):
            return 'slew'
        return 'heat' if heat_of(voltage, dt) > self.heat else ''

    def to_dict(self) -> dict[str, float | None]:
        """Return plain numbers for JSON; None where there is no limit."""
        return {k: v if isfinite(v) else None for k, v in asdict(self).items()}

    @classmethod
    def parse(cls, content: dict[str, float | None]) -> ExperimentLimits:
        """Return limits from what `to_dict` made."""
        return cls(**{k: inf if v is None else float(v) for k, v in content.items()})


def granted_range(
    asked: tuple[float, float], taken: tuple[float, float], model: ModelFile
) -> tuple[float, float]:
    """Return the limits of an investigation [V]: those that were asked for, kept as they are.

    Parameters
    ----------
    asked : tuple of float
        Of the goal; both 0, which are no range, where none are given: then those within which
        the model was judged.
    taken : tuple of float
        Which voltages the actuator takes; both 0 where it does not say.
    model : ModelFile
        In use.

    Raises
    ------
    InvestigationError
        If they are no range, exceed what the actuator takes, or nobody gives any.
    """
    if asked == (0.0, 0.0):
        asked = known_range(*taken, model) if taken[0] < taken[1] else taken
        if not asked[0] < asked[1]:
            raise InvestigationError(
                'the actuator does not publish its voltage range: give low and high'
            )
    if reason := range_refusal(*asked):
        raise InvestigationError(reason)
    if taken[0] < taken[1] and not taken[0] <= asked[0] < asked[1] <= taken[1]:
        raise InvestigationError(
            f'the voltage limits {asked[0]:g} .. {asked[1]:g} V exceed the '
            f'{taken[0]:g} .. {taken[1]:g} V that the actuator takes: narrow them'
        )
    return asked


def known_range(low: float, high: float, model: ModelFile) -> tuple[float, float]:
    """Return the part of a range of voltages [V] in which a model was judged.

    Beyond it nobody knows what the model misses. A range that reaches below 0 V is used on both
    sides of it.
    """
    conditions = model.discrepancy.conditions if model.discrepancy is not None else ()
    known = max((each.amplitude for each in conditions), default=inf)
    if low < 0.0 < high:
        return max(low, -known), min(high, known)
    return max(low, -2.0 * known), min(high, 2.0 * known)


def fastest(voltage: FloatArray, dt: float) -> float:
    """Return the largest change of commands [V/s], that from and to rest at 0 V included."""
    change = np.diff(voltage, prepend=0.0, append=0.0)
    return float(np.max(np.abs(change))) / dt


def heat_of(voltage: FloatArray, dt: float) -> float:
    """Return the mean of frequency times amplitude squared [V^2 Hz]; exact for whole sines."""
    moved = np.abs(np.diff(voltage)) * np.abs(0.5 * (voltage[1:] + voltage[:-1]))
    return float(np.sum(moved)) / (2.0 * voltage.size * dt)
