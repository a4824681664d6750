"""What these data can and cannot tell, said before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES, HIGH_FREQUENCY, Coverage
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.checks import require_consistent
from piezo_hysteresis.identification.units import require_plausible, unit_findings
from piezo_hysteresis.records import Record

FEWEST_SAMPLES = 200
CLIPPED_SHARE = 0.02


@dataclass(frozen=True)
class Check:
    """What was found.

    Attributes
    ----------
    findings : tuple of str
        What is wrong with the records, in words.
    confounded : tuple of (tuple of str, str)
        Effects that these records cannot tell apart, and what to record so that they can be.
    """

    findings: tuple[str, ...]
    confounded: tuple[tuple[tuple[str, ...], str], ...]

    def experiments(self) -> list[str]:
        """Return what to record, without doubles."""
        return list(dict.fromkeys(advice for _, advice in self.confounded))

    def sentences(self) -> list[str]:
        """Return everything in sentences."""
        rivals = [
            f'{", ".join(names)} cannot be distinguished: {a}' for names, a in self.confounded
        ]
        return [*self.findings, *rivals]


def check(records: Sequence[Record]) -> Check:
    """Look at rate, length, clipping, size and coverage of the records.

    Raises
    ------
    IdentificationError
        If nothing can be said from them; the message says why and what to record.
    """
    _refuse(records)
    findings = [finding for record in records for finding in _findings(record)]
    return Check(tuple(findings), tuple(_confounded(records)))


def _refuse(records: Sequence[Record]) -> None:
    require_consistent(records)
    require_plausible(records)
    if max(len(r) for r in records) < FEWEST_SAMPLES:
        raise IdentificationError(
            f'no record has {FEWEST_SAMPLES} samples: record several periods of each excitation'
        )


def _findings(record: Record) -> list[str]:
    found = [f'{record.name}: {sentence}' for _, sentence in unit_findings(record)]
    for what, signal in (('displacement', record.displacement), ('input', record.voltage)):
        share = _clipped(signal)
        if share > CLIPPED_SHARE and record.info.excitation not in _FLAT:
            found.append(
                f'{record.name}: the {what} rests at its largest or smallest value in '
                f'{100 * share:.0f} % of the samples; it may be clipped'
            )
    if float(np.ptp(record.voltage)) > 0 and abs(_correlation(record)) < 0.2:
        found.append(
            f'{record.name}: input and displacement hardly move together; check that both come '
            'from the same clock'
        )
    if _correlation(record) < -0.5:
        found.append(f'{record.name}: the displacement runs against the input; check the polarity')
    return found


_FLAT = ('rest', 'step', 'staircase', 'unknown')


def _clipped(signal: FloatArray) -> float:
    if float(np.ptp(signal)) == 0.0:
        return 0.0
    return max(_resting(signal == signal.max()), _resting(signal == signal.min()))


def _resting(there: BoolArray) -> float:
    """Return the share of samples that stay at a value: a sine passes through its peak."""
    stays = there[:-2] & there[1:-1] & there[2:]
    inside = np.zeros(there.size, np.bool_)
    for shift in range(3):
        inside[shift : shift + stays.size] |= stays
    return float(inside.mean())


def _correlation(record: Record) -> float:
    u, y = record.voltage - record.voltage.mean(), record.displacement - record.displacement.mean()
    size = float(np.sqrt((u @ u) * (y @ y)))
    return float(u @ y) / size if size > 0 else 1.0


def _confounded(records: Sequence[Record]) -> list[tuple[tuple[str, ...], str]]:
    """Return which effects need what the records do not hold, and how to record it."""
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
