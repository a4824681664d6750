"""Training and held-out views of records; held-out data only veto.

A view is an identification `Target`: the input signal and the measured samples that are compared
with the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.initial_conditions.record_start import first_guess
from piezo_hysteresis.identification.noise import Noise, floor_of, noises_of, stroke_of
from piezo_hysteresis.identification.periods import period_of
from piezo_hysteresis.identification.targets import Target, whole, with_noise, with_start_of
from piezo_hysteresis.records import Record

# Share of the records that is held out; with few records, share of each record.
HELD_OUT = 0.25
# Whole records are held out from this number of records on.
FEWEST_TO_SPARE = 6
# Samples on which models are fitted; of longer records the later samples are left out.
FIT_SAMPLES = 60_000
# Samples of a view that suffice at any sampling rate.
FEWEST_SAMPLES = 2_000
# Ratio of frequencies up to which drives show the same effects.
SIMILAR = 10.0
# Share of the largest rate of change of an input that counts as the largest.
ALMOST = 0.98


@dataclass(frozen=True)
class Dataset:
    """Records split into training and held-out views.

    Attributes
    ----------
    records : tuple of Record
        Original records.
    training, held_out : tuple of Target
        Views for fits, and views for the validation only.
    periods : dict of str to int
        Samples per period of the drive by record, 0 where it is not periodic.
    noise : Noise
        Noise of all records together; each view has its own.
    """

    records: tuple[Record, ...]
    training: tuple[Target, ...]
    held_out: tuple[Target, ...]
    periods: dict[str, int]
    noise: Noise

    @property
    def amplitude(self) -> float:
        """Largest input [V or N]."""
        return max(float(np.max(np.abs(r.voltage))) for r in self.records)

    @property
    def span(self) -> float:
        """Half the largest peak-to-peak displacement [m]."""
        return 0.5 * max(stroke_of(r) for r in self.records)

    def period(self, name: str) -> int:
        """Return the samples per period of the record named `name`."""
        return self.periods[name]

    def with_each(self, change: Callable[[Target], Target]) -> Dataset:
        """Return the data with a function applied to every view."""
        return replace(
            self,
            training=tuple(map(change, self.training)),
            held_out=tuple(map(change, self.held_out)),
        )


def split(records: Sequence[Record], start: str = 'auto') -> Dataset:
    """Split records into training and held-out views.

    With many sines, some are held out completely, but never the extremes of frequency and
    amplitude. The other sines and the chirps then train completely, because the end of a chirp is
    an extreme of frequency as well. Of any other record the last part is held out, and of an
    extreme that is unlike all held-out records.
    """
    noises = noises_of(records)
    floor = floor_of(records)
    if not floor.lines:
        raise IdentificationError(
            'no record shows the noise: record at least two periods of each excitation, or some '
            'seconds at rest'
        )
    periods = {r.name: _period(r) for r in records}
    spared = _spared(records)
    train_whole = ('sine', 'chirp') if spared else ('sine',)
    training: list[Target] = []
    held_out: list[Target] = []
    extremes: list[Target] = []
    for record, noise in zip(records, noises, strict=True):
        view = with_noise(whole(record, begins=first_guess(record, start)), noise)
        if record.name in spared:
            held_out.append(view)
            continue
        if len(records) >= FEWEST_TO_SPARE and record.info.excitation in train_whole:
            extremes.append(view)
            continue
        first, last = cut(view, 1.0 - HELD_OUT)
        training.append(first)
        held_out.append(last)
    cut_too = _unlike(extremes, held_out)
    for view in extremes:
        parts = cut(view, 1.0 - HELD_OUT) if view.name in cut_too else (view,)
        training.append(parts[0])
        held_out += parts[1:]
    order = {record.name: place for place, record in enumerate(records)}
    training.sort(key=lambda view: order[view.name])
    fitted = thinned(training, FIT_SAMPLES, periods)
    return Dataset(tuple(records), fitted, tuple(held_out), periods, floor)


def _unlike(whole: Sequence[Target], held_out: Sequence[Target]) -> set[str]:
    """Return the names of records that are unlike all held-out ones, so that their end joins them.

    Every effect must be able to show itself on held-out samples: creep with the slowest drive, a
    mode with the fastest, a nonlinearity with the largest and a drift in the longest record.
    """
    if not whole or not held_out:
        return {view.name for view in whole}
    driven = [view for view in whole if view.frequency > 0.0]

    def reach(view: Target) -> float:
        return float(np.ptp(view.voltage[view.origin :]))

    def seconds(view: Target) -> float:
        return (view.voltage.size - view.origin) * view.dt

    slowest = min(driven, key=lambda v: (v.frequency, -reach(v)), default=None)
    fastest = max(driven, key=lambda v: (v.frequency, reach(v)), default=None)
    largest, longest = max(whole, key=reach), max(whole, key=seconds)
    slow = min((v.frequency for v in held_out if v.frequency > 0.0), default=np.inf)
    fast = max(np.inf if v.frequency == 0.0 else v.frequency for v in held_out)
    found = set[str]()
    if slowest is not None and slow > SIMILAR * slowest.frequency:
        found.add(slowest.name)
    if fastest is not None and SIMILAR * fast < fastest.frequency:
        found.add(fastest.name)
    if 2.0 * max(map(reach, held_out)) < reach(largest):
        found.add(largest.name)
    if 2.0 * max(map(seconds, held_out)) < seconds(longest):
        found.add(longest.name)
    return found


def _period(record: Record) -> int:
    period = period_of(record)
    # A period counts only if the record contains at least two.
    return period if 0 < 2 * period <= len(record) else 0


def _spared(records: Sequence[Record]) -> set[str]:
    """Return the names of records to hold out: every fourth inner frequency of each amplitude."""
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
        # Neighbouring amplitudes hold out different frequencies.
        first = (place + 1) % 2 if len(inner) < 3 else place % 2 + 1
        spared.update(r.name for r in inner[first :: round(1.0 / HELD_OUT)])
    return spared


def cut(view: Target, share: float) -> tuple[Target, Target]:
    """Return the first `share` of the compared samples and the rest, with the same lead-in."""
    count = max(1, min(round(share * view.measured.size), view.measured.size - 1))
    return part_of(view, 0, count), part_of(view, count, view.measured.size)


def part_of(view: Target, first: int, last: int) -> Target:
    """Return the view with only the compared samples ``first`` to ``last - 1``."""
    return replace(
        view,
        voltage=view.voltage[: view.first + last * view.stride],
        measured=view.measured[first:last],
        first=view.first + first * view.stride,
        valid=None if view.valid is None else view.valid[first:last],
        influence=None if view.influence is None else view.influence[first:last],
    )


def beginning_like(data: Dataset, views: Sequence[Target]) -> Dataset:
    """Return the data with initial conditions, zero offsets and weights of `views`, by name.

    The held-out part of a record has the same initial condition as its training part.
    """
    known = {v.name: v for v in reversed(views)}

    def like(view: Target) -> Target:
        other = known.get(view.name)
        return (
            view
            if other is None
            else replace(with_start_of(view, other), precision=other.precision)
        )

    return data.with_each(like)


def thinned(views: Sequence[Target], samples: int, periods: dict[str, int]) -> tuple[Target, ...]:
    """Shorten views from their end until about `samples` are simulated in total.

    Every view keeps half a second or `FEWEST_SAMPLES`, with three periods, or one slower period
    and its turning points, and its fastest motion: the end of a chirp contains frequencies that
    occur nowhere else. The longest of the slowest views keeps more, because slow effects are
    visible only there.
    """
    total = sum(v.voltage.size for v in views)
    if total <= samples:
        return tuple(views)
    least = [
        min(v.voltage.size, max(v.first + _shortest(v, periods.get(v.name, 0)), _fastest(v)))
        for v in views
    ]
    slowest = int(np.argmax([v.voltage.size * v.dt / (1.0 + v.frequency) for v in views]))
    least[slowest] = min(views[slowest].voltage.size, max(least[slowest], samples // 5))
    spare = samples - sum(least)
    excess = np.array([v.voltage.size for v in views]) - np.array(least)
    share = max(0.0, spare) / max(float(excess.sum()), 1.0)
    kept = [base + int(share * more) for base, more in zip(least, excess, strict=True)]
    return tuple(
        part_of(v, 0, max(n - v.first, 0) // v.stride) for v, n in zip(views, kept, strict=True)
    )


def _shortest(view: Target, period: int) -> int:
    """Return the samples that a view keeps: three periods, or one that is long."""
    least = min(round(0.5 / view.dt), FEWEST_SAMPLES)
    return max(min(3 * period, max(round(1.25 * period), least)), least)


def _fastest(view: Target) -> int:
    """Return the number of samples until the input first reaches its largest rate of change."""
    speed = np.abs(np.diff(view.voltage, prepend=view.voltage[0]))
    return int(np.argmax(speed >= ALMOST * speed.max())) + 1
