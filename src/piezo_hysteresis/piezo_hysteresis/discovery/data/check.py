"""Check of quality and coverage of the records before any fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES, HIGH_FREQUENCY, Coverage
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.checks import require_usable, time_ahead
from piezo_hysteresis.identification.model_discrepancy import waveform_of
from piezo_hysteresis.identification.periods import main_frequency
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.repeated_records import form_name
from piezo_hysteresis.records import Record

FEWEST_SAMPLES = 200
# Ratio of frequencies, and share of a voltage range, from which a drive is unlike another one.
OCTAVE, BEYOND = 2.0, 0.1


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
    if max(len(r) for r in records) < FEWEST_SAMPLES:
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
    """Return which displacements run ahead of their drive: a model would take that for physics.

    If others lag, these lag by most of a period.
    """
    driven = [each for each in records if np.ptp(each.voltage) > 0.0]
    times = {each.name: time_ahead(each) for each in driven}
    early = [name for name, time in times.items() if time > 0.0]
    if not early or min(times.values()) < 0.0:
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
    fitted: Sequence[Target], held_out: Sequence[Target], unit: str = 'V'
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
        names = dict.fromkeys(effect.name for effect in EFFECTS if need in effect.shown_by)
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
