"""Check of the records, and their training and held-out views; held-out data only veto.

A view is an identification `FitData`: the input signal and the measured samples that are compared
with the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES, HIGH_FREQUENCY, Coverage
from piezo_hysteresis.discovery.data.second_channel import SensorCurve
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.checks import phase_ahead, require_usable, time_ahead
from piezo_hysteresis.identification.fit_data import FitData, whole, with_noise, with_start_of
from piezo_hysteresis.identification.initial_conditions.record_start import first_guess
from piezo_hysteresis.identification.model_discrepancy import waveform_of
from piezo_hysteresis.identification.noise import Noise, floor_of, noises_of, stroke_of
from piezo_hysteresis.identification.periods import main_frequency, period_of
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.repeated_records import form_name
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
    training, held_out : tuple of FitData
        Views for fits, and views for the validation only.
    periods : dict of str to int
        Samples per period of the drive by record, 0 where it is not periodic.
    noise : Noise
        Noise of all records together; each view has its own.
    second : SensorCurve or None
        What a second channel shows of the sensor; None without one.
    """

    records: tuple[Record, ...]
    training: tuple[FitData, ...]
    held_out: tuple[FitData, ...]
    periods: dict[str, int]
    noise: Noise
    second: SensorCurve | None = None

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

    def with_each(self, change: Callable[[FitData], FitData]) -> Dataset:
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
    training: list[FitData] = []
    held_out: list[FitData] = []
    extremes: list[FitData] = []
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


def _unlike(whole: Sequence[FitData], held_out: Sequence[FitData]) -> set[str]:
    """Return the names of records that are unlike all held-out ones, so that their end joins them.

    Every effect must be able to show itself on held-out samples: creep with the slowest drive, a
    mode with the fastest, a nonlinearity with the largest and a drift in the longest record.
    """
    if not whole or not held_out:
        return {view.name for view in whole}
    driven = [view for view in whole if view.frequency > 0.0]

    def reach(view: FitData) -> float:
        return float(np.ptp(view.voltage[view.origin :]))

    def seconds(view: FitData) -> float:
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


def cut(view: FitData, share: float) -> tuple[FitData, FitData]:
    """Return the first `share` of the compared samples and the rest, with the same lead-in."""
    count = max(1, min(round(share * view.measured.size), view.measured.size - 1))
    return part_of(view, 0, count), part_of(view, count, view.measured.size)


def part_of(view: FitData, first: int, last: int) -> FitData:
    """Return the view with only the compared samples ``first`` to ``last - 1``."""
    return replace(
        view,
        voltage=view.voltage[: view.first + last * view.stride],
        measured=view.measured[first:last],
        first=view.first + first * view.stride,
        valid=None if view.valid is None else view.valid[first:last],
        influence=None if view.influence is None else view.influence[first:last],
    )


def beginning_like(data: Dataset, views: Sequence[FitData]) -> Dataset:
    """Return the data with initial conditions, zero offsets and weights of `views`, by name.

    The held-out part of a record has the same initial condition as its training part.
    """
    known = {v.name: v for v in reversed(views)}

    def like(view: FitData) -> FitData:
        other = known.get(view.name)
        return (
            view
            if other is None
            else replace(with_start_of(view, other), precision=other.precision)
        )

    return data.with_each(like)


def thinned(
    views: Sequence[FitData], samples: int, periods: dict[str, int]
) -> tuple[FitData, ...]:
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


def _shortest(view: FitData, period: int) -> int:
    """Return the samples that a view keeps: three periods, or one that is long."""
    least = min(round(0.5 / view.dt), FEWEST_SAMPLES)
    return max(min(3 * period, max(round(1.25 * period), least)), least)


def _fastest(view: FitData) -> int:
    """Return the number of samples until the input first reaches its largest rate of change."""
    speed = np.abs(np.diff(view.voltage, prepend=view.voltage[0]))
    return int(np.argmax(speed >= ALMOST * speed.max())) + 1


_FEWEST_OF_A_RECORD = 200
# Ratio of frequencies, and share of a voltage range, from which a drive is unlike another one.
OCTAVE, BEYOND = 2.0, 0.1
_APART = 1.5  # ratio of frequencies from which a time differs from a phase


@dataclass(frozen=True)
class Check:
    """Result of the check.

    Attributes
    ----------
    findings : tuple of str
        Defects of the records, in words.
    confounded : tuple of (tuple of str, str)
        Effects that these records cannot distinguish, and the records that distinguish them.
    outside : str
        Sentence on operating conditions at which the model was not identified; empty without.
    """

    findings: tuple[str, ...]
    confounded: tuple[tuple[tuple[str, ...], str], ...]
    outside: str = ''

    def experiments(self) -> list[str]:
        """Return the recommended records without duplicates."""
        return list(dict.fromkeys(advice for _, advice in self.confounded))

    def sentences(self) -> list[str]:
        """Return all findings as sentences."""
        rivals = [
            f'{", ".join(names)} cannot be distinguished: {a}' for names, a in self.confounded
        ]
        return [*self.findings, *rivals]


def check(records: Sequence[Record]) -> Check:
    """Check rate, length, clipping, noise and coverage of the records."""
    findings = require_usable(records)
    if max(len(r) for r in records) < _FEWEST_OF_A_RECORD:
        raise IdentificationError(
            f'no record has {FEWEST_SAMPLES} samples: record several periods of each excitation'
        )
    return Check(tuple(findings), tuple(_confounded(records)))


@dataclass(frozen=True)
class Outside:
    """Operating conditions of records at which a model was not identified."""

    sentence: str = ''  # what differs; empty if nothing does
    entirely: bool = False  # whether nothing can be named from the records


def unsynchronised(records: Sequence[Record]) -> Outside:
    """Return which displacements run ahead of their drive by one time at all frequencies.

    A model would take that for physics. A loop that turns the other way leads by one phase.
    """
    driven = [each for each in records if np.ptp(each.voltage) > 0.0]
    early = {each.name: time for each in driven if (time := time_ahead(each)) > 0.0}
    phases = np.array([row for row in map(phase_ahead, driven) if row[0] > 0.0])
    if not early or phases[:, 0].max() < _APART * phases[:, 0].min():
        return Outside()
    expected = 2.0 * np.pi * float(np.median(list(early.values()))) * phases[:, 0]
    if np.any(np.abs(phases[:, 1] - expected) > 0.02 + 0.2 * expected):
        return Outside()
    return Outside(
        f'The displacement of {", ".join(early)} runs ahead of its drive, which no actuator does: '
        'the channels are not synchronised, and no effect is named. Record both with one clock.',
        True,
    )


def outside_of(records: Sequence[Record], given: ModelFile) -> Outside:
    """Return which drives are unlike those of a model file.

    A drive is unlike if its frequency is more than an octave beyond those at which the
    discrepancy of the model is known, its voltage beyond the range of the fitted records, its
    amplitude below half the smallest known one, or its waveform none of the known ones.
    """
    missed = given.discrepancy
    known = () if missed is None else missed.conditions
    driven = [each for each in records if np.ptp(each.voltage) > 0.0]
    unit = driven[0].info.input_unit if driven else 'V'
    drives = [each.info.frequency or main_frequency(each) for each in driven]
    own = [c.frequency for c in known if c.frequency > 0.0]
    beyond: list[set[int]] = [set()]
    found = []
    # a drive that is not periodic contains many frequencies
    if own and len(own) == len(known):
        low, high = min(own) / OCTAVE, max(own) * OCTAVE
        beyond.append({k for k, f in enumerate(drives) if f > 0.0 and not low <= f <= high})
        if beyond[-1]:
            there = [drives[k] for k in beyond[-1]]
            found.append(_against(min(there), max(there), min(own), max(own), 'Hz'))
    if given.provenance.voltage is not None:
        low, high = given.provenance.voltage.low, given.provenance.voltage.high
        spans = [(float(each.voltage.min()), float(each.voltage.max())) for each in driven]
        beyond.append({k for k, span in enumerate(spans) if _leaves(*span, low, high)})
        if beyond[-1]:
            there = [each for k in beyond[-1] for each in spans[k]]
            found.append(_against(min(there), max(there), low, high, unit))
    reaches = [0.5 * float(np.ptp(each.voltage)) for each in driven]
    least = min((c.amplitude for c in known), default=0.0)
    beyond.append({k for k, reach in enumerate(reaches) if OCTAVE * reach < least})
    if beyond[-1]:
        there = [reaches[k] for k in beyond[-1]]
        most = max(c.amplitude for c in known)
        found.append('an amplitude of ' + _against(min(there), max(there), least, most, unit))
    form_known = [c.drive for c in known if c.frequency > 0.0]
    for record, drive in zip(driven, drives, strict=True):
        form = waveform_of(record.voltage[record.warm_up_samples :], record.dt, drive)
        if missed is not None and drive > 0.0 and not missed.has_form(form):
            found.append(f'{form_name(form)} against {form_name(form_known[0])}')
    if not found:
        return Outside()
    what = ', '.join(dict.fromkeys(found))
    entirely = len(set.union(*beyond)) == len(driven)
    return Outside(
        f'The records are outside what the model was identified on: {what}.'
        + (' No effect is named from such records alone.' if entirely else ''),
        entirely,
    )


def _against(least: float, most: float, low: float, high: float, unit: str) -> str:
    return f'{_span(least, most, unit)} against {_span(low, high, unit)}'


def beyond_the_fit(
    fitted: Sequence[FitData], held_out: Sequence[FitData], unit: str = 'V'
) -> list[str]:
    """Return sentences on held-out parts at voltages (forces, in `unit` N) that no fit has seen.

    The last part of a ramp or of a staircase is such a part: a bank of plays has no weight there.
    """
    drives = [view.voltage[view.origin :] for view in fitted]
    low, high = min(float(u.min()) for u in drives), max(float(u.max()) for u in drives)
    found = []
    for view in held_out:
        u = view.voltage[view.first :]
        least, most = float(u.min()), float(u.max())
        if _leaves(least, most, low, high):
            found.append(
                f'record {view.name}: its held-out last part is at {_span(least, most, unit)}, '
                f'the fitted records at {_span(low, high, unit)}, so that its error is '
                'extrapolation; '
                'add a record that returns over the whole range, such as a slow triangle'
            )
    return found


def _leaves(least: float, most: float, low: float, high: float) -> bool:
    """Return whether `least` to `most` is beyond `low` to `high` by more than `BEYOND`."""
    return max(low - least, most - high) > BEYOND * (high - low)


def _span(low: float, high: float, unit: str) -> str:
    return f'{low:.3g} {unit}' if low == high else f'{low:.3g} .. {high:.3g} {unit}'


def _confounded(records: Sequence[Record]) -> list[tuple[tuple[str, ...], str]]:
    """Return the effects that the records cannot distinguish, with the records that are needed."""
    lacking = [need for need in Coverage if not _covers(need, records)]
    found = []
    for need in lacking:
        names = dict.fromkeys(
            effect.name for effect in EFFECTS if need in effect.required_coverage
        )
        found.append((tuple(names), need.value))
    return found


def _covers(need: Coverage, records: Sequence[Record]) -> bool:
    kinds = {r.info.excitation for r in records}
    frequencies = {r.info.frequency for r in records if r.info.frequency > 0}
    rich = bool(kinds & {'multisine', 'chirp', 'unknown'})
    if need is Coverage.FAST:
        return rich or max(frequencies, default=0.0) >= HIGH_FREQUENCY
    if need is Coverage.WIDE:
        return rich or len(frequencies) >= FEWEST_FREQUENCIES
    if need is Coverage.LADDER:
        moved = (r.voltage for r in records if np.ptp(r.voltage))
        return len({round(float(np.max(np.abs(u))), 3) for u in moved}) >= 2
    if need is Coverage.REST:
        return 'rest' in kinds or any(np.ptp(r.voltage) == 0 for r in records)
    if need is Coverage.STEP:
        return bool(kinds & {'step', 'staircase'})
    return 'reversal_curves' in kinds
