"""Check of quality and coverage of the records before any fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES, HIGH_FREQUENCY, Coverage
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import ModelFile
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
    """Check rate, length, clipping, noise and coverage of the records.

    Raises
    ------
    IdentificationError
        If the records cannot be evaluated; the message states the reason and what to record.
    """
    findings = require_usable(records)
    if max(len(r) for r in records) < FEWEST_SAMPLES:
        raise IdentificationError(
            f'no record has {FEWEST_SAMPLES} samples: record several periods of each excitation'
        )
    return Check(tuple(findings), tuple(_confounded(records)))


def outside_of(records: Sequence[Record], given: ModelFile) -> str:
    """Return a sentence on drives unlike those of a model file, empty if there are none.

    A drive is unlike if its frequency is more than an octave beyond those at which the
    discrepancy of the model is known, or its voltage beyond the range of the fitted records.
    """
    seen = () if given.discrepancy is None else given.discrepancy.conditions
    known = [each.frequency for each in seen]
    driven = [each for each in records if np.ptp(each.voltage) > 0.0]
    drives = [each.info.frequency for each in driven if each.info.frequency > 0.0]
    found = []
    # a drive that is not periodic contains many frequencies
    if drives and known and min(known) > 0.0:
        least, most = min(drives), max(drives)
        if most > OCTAVE * max(known) or least < min(known) / OCTAVE:
            found.append(
                f'{_span(least, most, "Hz")} against {_span(min(known), max(known), "Hz")}'
            )
    own = given.provenance.voltage
    if driven and own is not None:
        low = min(float(each.voltage.min()) for each in driven)
        high = max(float(each.voltage.max()) for each in driven)
        if _leaves(low, high, own.low, own.high):
            unit = driven[0].info.input_unit
            found.append(f'{_span(low, high, unit)} against {_span(own.low, own.high, unit)}')
    if not found:
        return ''
    return f'The records are outside what the model was identified on: {", ".join(found)}.'


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
