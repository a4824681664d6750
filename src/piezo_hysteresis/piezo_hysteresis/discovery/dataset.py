"""Training and held-out views of records: held-out data decide nothing.

A view is an identification `Target`: what the model is driven with from rest, and which measured
samples it is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.targets import Target, period_of
from piezo_hysteresis.records import Record

# Share of the records, and of what is left of records that cannot be spared, that is held out.
HELD_OUT = 0.25
# Whole records are held out from this number of records on.
FEWEST_TO_SPARE = 6
# A record that does not start at rest is led in by this much of its own period [s].
LEAD_IN = 3.0
# Share of the largest speed of an input that counts as fastest.
ALMOST = 0.98


@dataclass(frozen=True)
class Dataset:
    """Records split in two.

    Attributes
    ----------
    records : tuple of Record
        As they came.
    training, held_out : tuple of Target
        Views that fits see, and views that only the proof sees.
    periods : dict of str to int
        Samples per period of the drive by record, 0 where it is not periodic.
    """

    records: tuple[Record, ...]
    training: tuple[Target, ...]
    held_out: tuple[Target, ...]
    periods: dict[str, int]

    @property
    def amplitude(self) -> float:
        """Largest input [V or N]."""
        return max(float(np.max(np.abs(r.voltage))) for r in self.records)

    @property
    def span(self) -> float:
        """Half the largest peak-to-peak displacement [m]."""
        return 0.5 * max(float(np.ptp(r.displacement)) for r in self.records)

    def period(self, name: str) -> int:
        """Return the samples per period of the record called `name`."""
        return self.periods[name]


def split(records: Sequence[Record]) -> Dataset:
    """Split records into training and held-out views.

    Of many sines some are held out whole, never the extremes of frequency and amplitude. Beside
    them the others train whole, and so do chirps, whose end is an extreme of frequency as well;
    any other record gives its last part.
    """
    periods = {r.name: _period(r) for r in records}
    spared = _spared(records)
    whole = ('sine', 'chirp') if spared else ('sine',)
    training: list[Target] = []
    held_out: list[Target] = []
    for record in records:
        view = view_of(record, periods[record.name])
        if record.name in spared:
            held_out.append(view)
            continue
        if len(records) >= FEWEST_TO_SPARE and record.info.excitation in whole:
            training.append(view)
            continue
        first, last = cut(view, 1.0 - HELD_OUT)
        training.append(first)
        held_out.append(last)
    if not held_out:
        parts = [cut(view, 1.0 - HELD_OUT) for view in training]
        training, held_out = [first for first, _ in parts], [last for _, last in parts]
    return Dataset(tuple(records), tuple(training), tuple(held_out), periods)


def _period(record: Record) -> int:
    period = period_of(record)
    # Two periods at the least, else the word says nothing.
    return period if 0 < 2 * period <= len(record) else 0


def _spared(records: Sequence[Record]) -> set[str]:
    """Names of records that may be held out whole: every fourth inner one of its amplitude."""
    if len(records) < FEWEST_TO_SPARE:
        return set()
    spared: set[str] = set()
    groups: dict[float, list[Record]] = {}
    for record in records:
        if record.info.excitation == 'sine' and record.info.frequency > 0:
            groups.setdefault(round(float(np.max(np.abs(record.voltage))), 6), []).append(record)
    for place, amplitude in enumerate(sorted(groups)):
        group = sorted(groups[amplitude], key=lambda r: r.info.frequency)
        inner = group[1:-1]
        # Neighbouring amplitudes spare different frequencies.
        first = (place + 1) % 2 if len(inner) < 3 else place % 2 + 1
        spared.update(r.name for r in inner[first :: round(1.0 / HELD_OUT)])
    return spared


def view_of(record: Record, period: int) -> Target:
    """Return the whole record as a view, led in where it does not start at rest."""
    voltage = record.voltage
    first = record.warm_up_samples
    reach = float(np.max(np.abs(voltage))) or 1.0
    if period and abs(float(voltage[0])) > 0.02 * reach:
        turns = ceil(LEAD_IN / (period * record.dt))
        voltage = np.concatenate([np.tile(voltage[:period], turns), voltage])
        first += turns * period
    return Target(
        name=record.name,
        voltage=np.ascontiguousarray(voltage),
        measured=np.ascontiguousarray(record.displacement[record.warm_up_samples :]),
        first=first,
        stride=1,
        dt=record.dt,
        frequency=record.info.frequency,
        repeats=1,
        noise=float('nan'),
        period=0,
        start=record.start - (first - record.warm_up_samples) * record.dt,
    )


def cut(view: Target, share: float) -> tuple[Target, Target]:
    """Return the first `share` of the compared samples and the rest, both driven from rest."""
    count = max(1, min(round(share * view.measured.size), view.measured.size - 1))
    first = replace(
        view, voltage=view.voltage[: view.first + count], measured=view.measured[:count]
    )
    last = replace(view, first=view.first + count, measured=view.measured[count:])
    return first, last


def thinned(views: Sequence[Target], samples: int, periods: dict[str, int]) -> tuple[Target, ...]:
    """Shorten views from behind until about `samples` are simulated in all.

    Every view keeps three periods or half a second, and its fastest motion: what is at the end of
    a chirp shows nowhere else. The longest of the slowest keeps more, because slow effects show
    only there.
    """
    total = sum(v.voltage.size for v in views)
    if total <= samples:
        return tuple(views)
    least = [
        min(
            v.voltage.size,
            max(v.first + max(3 * periods.get(v.name, 0), round(0.5 / v.dt)), _fastest(v)),
        )
        for v in views
    ]
    slowest = int(np.argmax([v.voltage.size * v.dt / (1.0 + v.frequency) for v in views]))
    least[slowest] = min(views[slowest].voltage.size, max(least[slowest], samples // 5))
    spare = samples - sum(least)
    wanted = np.array([v.voltage.size for v in views]) - np.array(least)
    share = max(0.0, spare) / max(float(wanted.sum()), 1.0)
    kept = [base + int(share * more) for base, more in zip(least, wanted, strict=True)]
    return tuple(
        replace(v, voltage=v.voltage[:n], measured=v.measured[: n - v.first])
        for v, n in zip(views, kept, strict=True)
    )


def _fastest(view: Target) -> int:
    """Return the number of samples until the input has once moved as fast as it ever does."""
    speed = np.abs(np.diff(view.voltage, prepend=view.voltage[0]))
    return int(np.argmax(speed >= ALMOST * speed.max())) + 1


def errors_rms(errors: Sequence[FloatArray]) -> float:
    """Return the rms over all samples of several arrays."""
    count = sum(e.size for e in errors)
    return float(np.sqrt(sum(float(e @ e) for e in errors) / max(count, 1)))
