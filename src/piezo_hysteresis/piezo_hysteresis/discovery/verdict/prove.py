"""Validation: gaps of baseline and final model on held-out records, and over frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.identification.targets import Target


@dataclass(frozen=True)
class ProofRow:
    """Gaps of one view."""

    record: str  # name of the record
    frequency: float  # drive frequency [Hz]
    amplitude: float  # amplitude [V]
    before: float  # rms residual without [m]
    after: float  # with the found effects [m]
    held_out: bool = True  # whether the view is held out from every fit and decision


@dataclass(frozen=True)
class Proof:
    """Gaps without and with the found effects.

    Attributes
    ----------
    rows : tuple of ProofRow
        Gaps of the held-out views, sorted by frequency.
    before, after : float
        Rms residual over all held-out views [m].
    before_in_floors, after_in_floors : float
        The same, each residual in multiples of the noise of its record.
    stable : bool
        Whether the free run stays within a few strokes for every held-out drive.
    """

    rows: tuple[ProofRow, ...]
    before: float
    after: float
    before_in_floors: float
    after_in_floors: float
    stable: bool


def prove(data: Dataset, before: CandidateFit, after: CandidateFit) -> Proof:
    """Return the gaps of two models on the held-out views."""
    old, new = before.errors, after.errors
    rows = [_row(v, a, b) for v, a, b in zip(data.held_out, old, new, strict=True)]
    limit = 10.0 * data.span
    stable = all(bool(np.all(np.abs(e) < limit)) for e in new)
    ordered = sorted(rows, key=lambda r: (r.frequency, r.amplitude, r.record))
    return Proof(tuple(ordered), before.rms, after.rms, before.floors, after.floors, stable)


def over_frequency(
    data: Dataset, before: CandidateFit, after: CandidateFit, proof: Proof
) -> list[ProofRow]:
    """Return the gaps of all records with a drive frequency, sorted by frequency.

    This is Figure 10 of Fujii 2018 for any model and any effect.
    """
    trained = [
        replace(_row(view, old, new), held_out=False)
        for view, old, new in zip(data.training, before.errors, after.errors, strict=True)
    ]
    rows = [row for row in (*trained, *proof.rows) if row.frequency > 0.0]
    return sorted(rows, key=lambda r: (r.frequency, r.amplitude, r.record, r.held_out))


def _row(view: Target, before: FloatArray, after: FloatArray) -> ProofRow:
    return ProofRow(
        view.name,
        view.frequency,
        float(np.max(np.abs(view.voltage))),
        float(np.sqrt(np.mean(np.square(before)))),
        float(np.sqrt(np.mean(np.square(after)))),
    )
