"""Model discrepancy: the known error of a model by frequency, harmonic and amplitude.

No model of a real actuator is exact to the noise. The residual on the evaluated records is part of
the model like its values: an error of that size on other records is expected.
"""

from __future__ import annotations

from cmath import rect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite, log2, sqrt
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.plain import mapping, number, refuse_unknown
from piezo_hysteresis.models.repeated_records import (
    anew,
    are_alike,
    kinds_of,
    root_mean_square,
    same_form,
    together,
)
from piezo_hysteresis.models.repeating import KnownResidual, Repeating, of_orders, repeating
from piezo_hysteresis.numerics.harmonics import HIGHEST_ORDER

_DIGITS = 4
# Conditions nearer than this are the same; others are weighted by distance to the power -4, so
# that known conditions are reproduced and those in between interpolated [octaves].
_NEAR = 0.02


@dataclass(frozen=True)
class Condition:
    """Discrepancy of a model at one frequency and amplitude of the drive.

    Attributes
    ----------
    frequency : float
        Frequency of the drive [Hz]; 0 if it is not periodic.
    amplitude : float
        Half the range of the input [V or N].
    stroke : float
        Range of the measured displacement [m].
    rms : float
        Of the free-run error [m], noise included.
    noise : float or None
        Rms of the noise in it [m], if known.
    harmonics : mapping of int to float
        Rms of the error at the mean (0) and at each significant harmonic [m].
    bands : mapping of float to float
        Rms of the error in the octave from each frequency [Hz] on [m]; 0 is the mean. For a
        periodic drive without its harmonics, and beyond the noise.
    phases : mapping of int to float
        Phase of each harmonic [rad] minus its order times that of the drive; if known.
    scatter : mapping of int to float
        Rms variation of each harmonic between parts of the record, at the largest amplitude of the
        drive [m]; if the record is long enough. Of several records, between them, too.
    drive : mapping of int to float
        Waveform of the drive: amplitude of its second and third harmonic over that of the first,
        which is 1; for an aperiodic one the share of each octave from ``2**key`` Hz on in its rms.
        Empty if unknown.
    records : int
        Records that were merged.
    """

    frequency: float
    amplitude: float
    stroke: float
    rms: float
    noise: float | None = None
    harmonics: Mapping[int, float] = field(default_factory=dict)
    bands: Mapping[float, float] = field(default_factory=dict)
    phases: Mapping[int, float] = field(default_factory=dict)
    scatter: Mapping[int, float] = field(default_factory=dict)
    drive: Mapping[int, float] = field(default_factory=dict)
    records: int = 1

    def __post_init__(self) -> None:
        numbers = [self.frequency, self.amplitude, self.rms, self.noise or 0.0]
        numbers += [*self.harmonics.values(), *self.bands.values(), *self.bands]
        numbers += [*self.scatter.values(), *self.drive.values()]
        if not all(isfinite(x) and x >= 0.0 for x in numbers) or not self.stroke > 0.0:
            raise ModelError('a discrepancy holds sizes, which are finite and not negative')
        if not all(map(isfinite, self.phases.values())):
            raise ModelError('the phases of a discrepancy must be finite')

    @property
    def missed(self) -> float:
        """Rms of the error in excess of the noise, if that is known [m]."""
        return sqrt(max(self.rms**2 - (self.noise or 0.0) ** 2, 0.0))

    @property
    def share(self) -> float:
        """Discrepancy relative to the stroke."""
        return self.missed / self.stroke

    @property
    def phasors(self) -> dict[int, complex] | None:
        """Phasors of the harmonics relative to the stroke; None if a phase is unknown."""
        orders = [order for order in self.harmonics if order > 0]
        if self.frequency <= 0.0 or not set(orders) <= set(self.phases):
            return None
        return {n: rect(self.harmonics[n] / self.stroke, self.phases[n]) for n in orders}

    def to_dict(self) -> dict[str, Any]:
        """Return a row of plain numbers without empty entries."""
        row: dict[str, Any] = {
            'frequency': _short(self.frequency),
            'amplitude': _short(self.amplitude),
            'stroke': _short(self.stroke),
            'rms': _short(self.rms),
            'share': _short(self.share),
        }
        if self.noise is not None:
            row['noise'] = _short(self.noise)
        if self.harmonics:
            row['harmonics'] = {k: _short(v) for k, v in self.harmonics.items()}
        if self.bands:
            row['bands'] = {_short(k): _short(v) for k, v in self.bands.items()}
        if self.phases:
            row['phases'] = {k: _short(v) for k, v in self.phases.items()}
        if self.scatter:
            row['scatter'] = {k: _short(v) for k, v in self.scatter.items()}
        if self.drive:
            row['drive'] = {k: _short(v) for k, v in self.drive.items()}
        return row

    @classmethod
    def parse(cls, content: object) -> Condition:
        """Read a row from `to_dict`.

        Raises
        ------
        ModelError
            If anything is unknown, missing or impossible.
        """
        row = mapping(content, 'a row of the discrepancy')
        known = {*cls.__dataclass_fields__, 'share'} - {'records'}
        refuse_unknown(row, known, 'a row of the discrepancy')

        def size(name: str) -> float:
            return number(row.get(name), f'discrepancy {name}')

        def table(name: str) -> dict[float, float]:
            rows = mapping(row.get(name, {}), f'discrepancy {name}')
            return {
                number(key, f'discrepancy {name}'): number(value, f'discrepancy {name}')
                for key, value in rows.items()
            }

        return cls(
            size('frequency'),
            size('amplitude'),
            size('stroke'),
            size('rms'),
            size('noise') if 'noise' in row else None,
            {int(order): rms for order, rms in table('harmonics').items()},
            table('bands'),
            {int(order): phase for order, phase in table('phases').items()},
            {int(order): rms for order, rms in table('scatter').items()},
            {int(order): size for order, size in table('drive').items()},
        )


@dataclass(frozen=True)
class Missed:
    """Discrepancy relative to the stroke near one condition.

    Attributes
    ----------
    share : float
        Its rms as a share of the stroke.
    harmonics : mapping of int to float
        The same at the mean (0) and at each harmonic.
    scatter : mapping of int to float
        Rms variation of each harmonic between parts of a record, as a share of the stroke.
    octaves : tuple of (float, float, float)
        Lowest and highest frequency [Hz], and the density of the square of the share between
        them [1/Hz].
    anew : float
        Share of its mean square that may come anew on another record [1].
    """

    share: float
    harmonics: Mapping[int, float]
    scatter: Mapping[int, float]
    octaves: tuple[tuple[float, float, float], ...]
    anew: float = 0.0

    def density(self, frequency: FloatArray) -> FloatArray:
        """Return the density between the harmonics at frequencies [Hz], shape (n,) [1/Hz].

        Below the lowest known octave it is constant.
        """
        found = np.zeros(frequency.size)
        lowest = min((low for low, _, _ in self.octaves), default=0.0)
        for low, high, density in self.octaves:
            begin = 0.0 if low == lowest else low
            found[(frequency >= begin) & (frequency < high)] += density
        return found


@dataclass(frozen=True)
class Discrepancy:
    """Known discrepancy of a model.

    Attributes
    ----------
    held_out : bool
        Whether it was evaluated on records that were not fitted; on the fitted ones it is smaller
        than elsewhere.
    conditions : tuple of Condition
        One per record, by frequency and amplitude; not empty.
    traces : tuple of Trace
        Residuals of available records; a file contains none.

    Raises
    ------
    ModelError
        If there is no condition.
    """

    held_out: bool
    conditions: tuple[Condition, ...]
    traces: tuple[KnownResidual, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if not self.conditions:
            raise ModelError('a discrepancy needs at least one row; remove it or identify again')

    @cached_property
    def kinds(self) -> tuple[Condition, ...]:
        """The conditions with those of one kind as one: `together`."""
        return tuple(map(together, kinds_of(self.conditions)))

    @property
    def rms(self) -> float:
        """Rms over all conditions with equal weight [m], noise included."""
        return root_mean_square(c.rms for c in self.conditions)

    @property
    def missed(self) -> float:
        """Rms over all conditions in excess of the noise [m]."""
        return root_mean_square(c.missed for c in self.conditions)

    @property
    def share(self) -> float:
        """Discrepancy relative to the stroke of each condition."""
        return root_mean_square(c.share for c in self.conditions)

    def by_frequency(self) -> dict[float, float]:
        """Return the rms [m] at each frequency of the drive [Hz], over all amplitudes."""
        return self._by(lambda c: c.frequency)

    def by_amplitude(self) -> dict[float, float]:
        """Return the rms [m] at each amplitude of the drive [V or N], over all frequencies."""
        return self._by(lambda c: c.amplitude)

    def by_harmonic(self) -> dict[int, float]:
        """Return the rms [m] at each harmonic, over all conditions with a periodic drive."""
        periodic = [c for c in self.conditions if c.frequency > 0.0]
        orders = sorted({order for c in periodic for order in c.harmonics})
        return {n: root_mean_square(c.harmonics.get(n, 0.0) for c in periodic) for n in orders}

    def _by(self, key: Callable[[Condition], float]) -> dict[float, float]:
        keys = sorted({key(c) for c in self.conditions})
        return {k: root_mean_square(c.rms for c in self.conditions if key(c) == k) for k in keys}

    def expected(
        self, frequency: float, amplitude: float, stroke: float, noise: float | None = None
    ) -> float:
        """Return the expected error under other conditions [m].

        The relative discrepancies of all conditions, weighted by their distance in frequency and
        amplitude (equal for an aperiodic drive), and the noise.

        Parameters
        ----------
        frequency : float
            Frequency of the drive [Hz]; 0 if it is not periodic.
        amplitude : float
            Half the range of the input [V or N].
        stroke : float
            Range of the displacement [m].
        noise : float, optional
            Rms of the noise [m]; default that under the known conditions.
        """
        if noise is None:
            noise = self.noise
        return sqrt((self.near(frequency, amplitude).share * stroke) ** 2 + noise**2)

    @property
    def noise(self) -> float:
        """Rms of the noise over all conditions [m]; 0 if unknown."""
        return root_mean_square(c.noise or 0.0 for c in self.conditions)

    def has_form(self, drive: Mapping[int, float]) -> bool:
        """Return whether a periodic waveform is among the known ones, or none of them is known."""
        known = [c.drive for c in self.conditions if c.frequency > 0.0]
        return not known or any(same_form(drive, each) for each in known)

    def repeated(self, frequency: float, amplitude: float) -> Condition | None:
        """Return the repeated records, merged, whose drive is repeated; None without."""
        drive = Condition(frequency, amplitude, 1.0, 0.0)
        found = [c for c in self.kinds if c.records > 1 and are_alike(c, drive)]
        return min(found, key=lambda c: _apart(c.frequency, frequency), default=None)

    def near(self, frequency: float, amplitude: float) -> Missed:
        """Return the discrepancy near a condition, as in `expected`, by line and octave."""
        kind = self.repeated(frequency, amplitude)
        if kind is not None:
            frequency, amplitude = kind.frequency, kind.amplitude
        weights = [
            (_NEAR**2 + _apart(c.frequency, frequency) ** 2 + _apart(c.amplitude, amplitude) ** 2)
            ** -2
            for c in self.kinds
        ]
        shares = [weight / sum(weights) for weight in weights]
        pairs = list(zip(shares, self.kinds, strict=True))

        def lines(of: Callable[[Condition], Mapping[int, float]]) -> dict[int, float]:
            orders = sorted({order for c in self.kinds for order in of(c)})
            return {
                n: sqrt(sum(w * (of(c).get(n, 0.0) / c.stroke) ** 2 for w, c in pairs))
                for n in orders
            }

        return Missed(
            sqrt(sum(w * c.share**2 for w, c in pairs)),
            lines(lambda c: c.harmonics),
            lines(lambda c: c.scatter),
            tuple(
                (low, 2.0 * low, w * (rms / c.stroke) ** 2 / low)
                for w, c in pairs
                for low, rms in c.bands.items()
                if low > 0.0
            ),
            sum(w * anew(c) for w, c in pairs),
        )

    def octaves_from(self, frequency: float, amplitude: float) -> float:
        """Return the distance of a drive from the nearest known condition [octaves]."""
        if self.repeated(frequency, amplitude) is not None:
            return 0.0
        return min(
            _apart(c.frequency, frequency) + _apart(c.amplitude, amplitude) for c in self.kinds
        )

    def repeats(self, frequency: float, amplitudes: FloatArray) -> dict[int, Repeating] | None:
        """Return the predicted harmonics of the discrepancy relative to the stroke, by order.

        Parameters
        ----------
        frequency : float
            Frequency of the drive [Hz].
        amplitudes : ndarray, shape (n,)
            Amplitudes of the drive [V or N].

        Returns
        -------
        dict of int to Repeating, or None
            None if the phases are unknown under any condition with a periodic drive.
        """
        periodic = [c for c in self.kinds if c.frequency > 0.0]
        rows = [row for row in (c.phasors for c in periodic) if row is not None]
        if frequency <= 0.0 or not rows or len(rows) < len(periodic):
            return None
        most = float(amplitudes.max(initial=0.0))
        kind = self.repeated(frequency, most)
        if kind is not None:
            frequency, amplitudes = kind.frequency, amplitudes * (kind.amplitude / most)
        orders = range(1, HIGHEST_ORDER + 1)
        places = np.array([(c.frequency, c.amplitude) for c in periodic])
        phasors = np.array([[row.get(n, 0.0) for row in rows] for n in orders], np.complex128)
        drives = np.column_stack([np.full(amplitudes.size, frequency), amplitudes])
        return of_orders(orders, *repeating(places, phasors, drives))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of a file, in plain types only."""
        return {
            'judged_on': 'held-out' if self.held_out else 'fitted',
            'rms': _short(self.rms),
            'share': _short(self.share),
            'conditions': [c.to_dict() for c in self.conditions],
        }

    @classmethod
    def parse(cls, content: object) -> Discrepancy:
        """Read the output of `to_dict`; derived values are recomputed.

        Raises
        ------
        ModelError
            If anything is unknown, missing or impossible.
        """
        whole = mapping(content, 'discrepancy')
        refuse_unknown(whole, {'judged_on', 'rms', 'share', 'conditions'}, 'discrepancy')
        judged = whole.get('judged_on')
        if judged not in ('held-out', 'fitted'):
            raise ModelError(
                f'discrepancy is evaluated on held-out or fitted data, got {judged!r}'
            )
        rows = whole.get('conditions')
        if not isinstance(rows, list):
            raise ModelError('the conditions of the discrepancy must be a list')
        return cls(judged == 'held-out', tuple(Condition.parse(row) for row in rows))


def _short(value: float) -> float:
    return float(f'{value:.{_DIGITS}g}')


def _apart(one: float, other: float) -> float:
    """Return the distance of two frequencies or amplitudes [octaves]."""
    if one == other:
        return 0.0
    return abs(log2(one / other)) if one > 0.0 and other > 0.0 else 4.0
