"""The proof: before and after on records that decided nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.dataset import Dataset, errors_rms
from piezo_hysteresis.discovery.trial import Trial, errors_of
from piezo_hysteresis.identification.targets import Target


@dataclass(frozen=True)
class ProofRow:
    """One held-out view.

    Attributes
    ----------
    record : str
        Name of the record.
    frequency, amplitude : float
        Of the drive [Hz], [V].
    before, after : float
        Rms of the gap without and with what was found [m].
    """

    record: str
    frequency: float
    amplitude: float
    before: float
    after: float


@dataclass(frozen=True)
class Proof:
    """Before and after.

    Attributes
    ----------
    rows : tuple of ProofRow
        By held-out view, sorted by frequency.
    before, after : float
        Rms over all of them [m].
    stable : bool
        Whether the free run stays within a few strokes on every held-out drive.
    """

    rows: tuple[ProofRow, ...]
    before: float
    after: float
    stable: bool


def prove(data: Dataset, before: Trial, after: Trial) -> Proof:
    """Judge two models on the held-out views."""
    views = data.held_out
    old = errors_of(before.model, before.values, views)
    new = errors_of(after.model, after.values, views)
    rows = [_row(v, a, b) for v, a, b in zip(views, old, new, strict=True)]
    limit = 10.0 * data.span
    stable = all(bool(np.all(np.abs(e) < limit)) for e in new)
    ordered = sorted(rows, key=lambda r: (r.frequency, r.amplitude, r.record))
    return Proof(tuple(ordered), errors_rms(old), errors_rms(new), stable)


def _row(view: Target, before: FloatArray, after: FloatArray) -> ProofRow:
    return ProofRow(
        view.name,
        view.frequency,
        float(np.max(np.abs(view.voltage))),
        float(np.sqrt(np.mean(np.square(before)))),
        float(np.sqrt(np.mean(np.square(after)))),
    )
