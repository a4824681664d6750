"""Safety limits of experiments, set by the user."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import inf, isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.ranges import range_refusal
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile

# Relative rounding of commands that does not violate a limit.
_ROUNDING = 1e-9


class InvestigationError(PiezoError):
    """An investigation cannot run with the given settings."""


@dataclass(frozen=True)
class ExperimentLimits:
    """Limits of every experiment."""

    low: float  # [V]
    high: float  # [V]
    slew: float = inf  # largest slew rate of the command [V/s]
    frequency: float = 100.0  # highest frequency of a drive [Hz]
    stroke: float = inf  # largest range of the displacement predicted by the model in use [m]
    heat: float = inf  # [V^2 Hz]
    rest: float = 0.0  # voltage before, between and after the experiments [V]

    def __post_init__(self) -> None:
        if reason := range_refusal(self.low, self.high):
            raise InvestigationError(reason)
        if not isfinite(self.rest):
            raise InvestigationError('the voltage at rest must be a finite number [V]')
        object.__setattr__(self, 'rest', min(max(self.rest, self.low), self.high))
        for name in ('slew', 'frequency', 'stroke', 'heat'):
            if not getattr(self, name) > 0.0:
                raise InvestigationError(f'the limit {name} must be above 0')
        if not isfinite(self.frequency):
            raise InvestigationError('the limit frequency must be a finite number [Hz]')

    @property
    def middle(self) -> float:
        """Center voltage of the experiments [V]."""
        return 0.5 * (self.low + self.high)

    @property
    def amplitude(self) -> float:
        """Largest amplitude about the center voltage [V]."""
        return 0.5 * (self.high - self.low)

    def refusal(self, voltage: FloatArray, dt: float) -> str:  # voltage (n,); dt [s]
        """Return the name of the violated limit, empty if there is none.

        The stroke is not checked.
        """
        slack = _ROUNDING * max(1.0, self.high - self.low)
        if float(voltage.min()) < self.low - slack or float(voltage.max()) > self.high + slack:
            return 'voltage'
        if fastest(voltage, dt, self.rest) > self.slew * (1.0 + _ROUNDING):
            return 'slew'
        return 'heat' if heat_of(voltage, dt) > self.heat else ''

    def to_dict(self) -> dict[str, float | None]:
        """Return plain numbers for JSON; None for an unlimited quantity."""
        return {k: v if isfinite(v) else None for k, v in asdict(self).items()}

    @classmethod
    def parse(cls, content: dict[str, float | None]) -> ExperimentLimits:
        """Return the limits from the output of `to_dict`."""
        return cls(**{k: inf if v is None else float(v) for k, v in content.items()})


def granted_range(
    asked: tuple[float, float], taken: tuple[float, float], model: ModelFile
) -> tuple[float, float]:
    """Return the voltage limits of an investigation [V]; requested limits are kept or rejected."""
    if asked == (0.0, 0.0):
        asked = known_range(*taken, model) if taken[0] < taken[1] else taken
        if not asked[0] < asked[1]:
            raise InvestigationError(
                'the actuator does not publish its voltage range: give low and high'
            )
    if reason := range_refusal(*asked):
        raise InvestigationError(reason)
    if not asked[0] <= 0.0 <= asked[1]:
        raise InvestigationError(
            f'the voltage limits {asked[0]:g} .. {asked[1]:g} V exclude 0 V, where nodes and '
            'controllers begin and end every experiment: include it, or investigate with '
            'ph.investigate, which begins and ends at the permitted voltage nearest to rest'
        )
    if taken[0] < taken[1] and not taken[0] <= asked[0] < asked[1] <= taken[1]:
        raise InvestigationError(
            f'the voltage limits {asked[0]:g} .. {asked[1]:g} V exceed the '
            f'{taken[0]:g} .. {taken[1]:g} V that the actuator takes: narrow them'
        )
    return asked


def known_range(low: float, high: float, model: ModelFile) -> tuple[float, float]:
    """Return the part of a voltage range [V] in which the model was evaluated.

    Outside it the discrepancy of the model is unknown. A range that extends below 0 V is used
    symmetrically.
    """
    conditions = model.discrepancy.conditions if model.discrepancy is not None else ()
    known = max((each.amplitude for each in conditions), default=inf)
    if low < 0.0 < high:
        return max(low, -known), min(high, known)
    return max(low, -2.0 * known), min(high, 2.0 * known)


def fastest(voltage: FloatArray, dt: float, rest: float = 0.0) -> float:
    """Return the largest slew rate of the commands [V/s], with the ways from and to `rest` [V]."""
    change = np.diff(voltage, prepend=rest, append=rest)
    return float(np.max(np.abs(change))) / dt


def heat_of(voltage: FloatArray, dt: float) -> float:
    """Return the mean of frequency times amplitude squared [V^2 Hz]; exact for whole sines."""
    moved = np.abs(np.diff(voltage)) * np.abs(0.5 * (voltage[1:] + voltage[:-1]))
    return float(np.sum(moved)) / (2.0 * voltage.size * dt)
