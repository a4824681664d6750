"""The voltages at which a model was identified: range, slew rate and rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.plain import mapping, number, refuse_unknown

# Share of the range by which records may miss 0 V that still reach it, such as those of a monitor
# with an offset.
_NEAR = 0.02


class Driven(Protocol):
    """A record, as far as its voltage is concerned."""

    @property
    def voltage(self) -> FloatArray:
        """Voltage of every sample [V], shape (n,)."""

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""


@dataclass(frozen=True)
class OperatingRange:
    """The voltages at which a model was identified."""

    low: float  # lowest [V]
    high: float  # highest voltage of the records [V]
    slew: float  # fastest change of the voltage from sample to sample [V/s]
    rest: float  # voltage at rest [V]

    def __post_init__(self) -> None:
        known = all(isfinite(value) for value in asdict(self).values())
        if not (known and self.low <= self.rest <= self.high and self.low < self.high):
            raise ModelError(
                f'an operating range of {self.low:g} .. {self.high:g} V that rests at '
                f'{self.rest:g} V is none; correct it or identify again'
            )
        if not self.slew > 0.0:
            raise ModelError('the slew rate of an operating range must be above 0 V/s')

    @classmethod
    def of(cls, records: Iterable[Driven]) -> OperatingRange | None:
        """Return what the records cover together, None where no voltage changes."""
        lows, highs, slews = [], [], [0.0]
        for record in records:
            lows.append(float(np.min(record.voltage)))
            highs.append(float(np.max(record.voltage)))
            slews.append(float(np.max(np.abs(np.diff(record.voltage)), initial=0.0)) / record.dt)
        if not (lows and max(slews) > 0.0):
            return None
        return cls._between(min(lows), max(highs), max(slews))

    def joined(self, other: OperatingRange | None) -> OperatingRange:
        """Return what this range and `other` cover together."""
        if other is None:
            return self
        return self._between(
            min(self.low, other.low), max(self.high, other.high), max(self.slew, other.slew)
        )

    @classmethod
    def _between(cls, low: float, high: float, slew: float) -> OperatingRange:
        margin = _NEAR * (high - low)
        near = low - margin <= 0.0 <= high + margin
        return cls(low, high, slew, min(max(0.0, low), high) if near else 0.5 * (low + high))

    @classmethod
    def parse(cls, content: object) -> OperatingRange:
        """Read the mapping of a model file."""
        rows: Mapping[str, object] = mapping(content, 'provenance voltage')
        names = [each.name for each in fields(cls)]
        refuse_unknown(rows, set(names), 'provenance voltage')
        return cls(*(number(rows.get(name), f'provenance voltage {name}') for name in names))
