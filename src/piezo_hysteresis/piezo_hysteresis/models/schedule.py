"""One set of parameters for each drive frequency: the schedule of a model file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from math import isfinite
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.plain import mapping, number, refuse_unknown

if TYPE_CHECKING:
    from piezo_hysteresis.models.modelfile import ModelFile

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


#: The only variable of a schedule.
BY_FREQUENCY = 'frequency'
_OWN = ('frequency', 'amplitude', 'travel', 'order')


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """The model of one drive."""

    frequency: float  # fundamental frequency of the drive [Hz]
    amplitude: float  # amplitude of its voltage [V]
    travel: float  # half the range of its displacement [m]
    order: int  # odd harmonic of the displacement that is above the hysteresis, 0 for none
    model: ModelFile  # chain, values and deviations, without a schedule of its own

    def __post_init__(self) -> None:
        if not (self.frequency > 0.0 and self.amplitude > 0.0 and self.travel >= 0.0):
            raise ModelError(
                f'an entry of a schedule has a frequency of {self.frequency:g} Hz and an '
                f'amplitude of {self.amplitude:g} V; both must be positive'
            )

    @property
    def name(self) -> str:
        """The drive in words."""
        return f'{self.frequency:g} Hz, {self.amplitude:g} V'


@dataclass(frozen=True)
class Schedule:
    """Models by drive, of which the nearest is used.

    Parameters between two frequencies are not interpolated: those of a hysteresis are strongly
    correlated, and the mean of two sets describes a third actuator.
    """

    points: tuple[OperatingPoint, ...]  # at least one; sorted by frequency and amplitude

    def __post_init__(self) -> None:
        if not self.points:
            raise ModelError('a schedule needs at least one entry')
        ordered = sorted(self.points, key=lambda p: (p.frequency, p.amplitude))
        object.__setattr__(self, 'points', tuple(ordered))
        names = [point.name for point in ordered]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ModelError(f'the schedule has two entries for {sorted(twice)[0]}; keep one')

    def at(self, frequency: float, amplitude: float | None = None) -> OperatingPoint:
        """Return the entry of the nearest frequency [Hz] and of it the nearest amplitude [V]."""
        # frequency [Hz]; amplitude [V]
        row = self.row(frequency)
        if amplitude is None:
            return row[-1]
        return min(row, key=lambda p: abs(p.amplitude - amplitude))

    def row(self, frequency: float) -> tuple[OperatingPoint, ...]:
        """Return the entries of the nearest frequency [Hz], smallest amplitude first."""
        nearest = min((p.frequency for p in self.points), key=lambda f: abs(f - frequency))
        return tuple(p for p in self.points if p.frequency == nearest)

    def without(self, frequency: float) -> Schedule | None:
        """Return the schedule without the entries of a frequency [Hz], None if none is left."""
        left = tuple(p for p in self.points if p.frequency != frequency)
        return replace(self, points=left) if left else None

    def to_dict(self) -> dict[str, Any]:
        """Return the entries as plain types, by drive."""
        return {
            point.name: {
                **{name: getattr(point, name) for name in _OWN},
                **{k: v for k, v in point.model.to_dict().items() if k != 'schema'},
            }
            for point in self.points
        }

    @classmethod
    def parse(cls, content: object, read: Callable[[Mapping[str, Any]], ModelFile]) -> Schedule:
        """Return the schedule of plain types; `read` reads the model of an entry."""
        points = []
        for name, each in mapping(content, 'entries of the schedule').items():
            row = dict(mapping(each, f'entry {name}'))
            own = {key: number(row.pop(key, None), f'{key} of entry {name}') for key in _OWN}
            order = int(own.pop('order'))
            points.append(OperatingPoint(**own, order=order, model=read(row)))
        return cls(tuple(points))
