"""Model file of a discovery: values, standard deviations, provenance and discrepancy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from piezo_hysteresis.identification.model_discrepancy import discrepancy_of, residual_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.prediction import predictions, with_mean_zero
from piezo_hysteresis.identification.simulate import free_runs
from piezo_hysteresis.models import Correlation, Discrepancy, ModelFile, Provenance
from piezo_hysteresis.models.modelfile import OFFSET_NOTE, OFFSET_STD_NOTE
from piezo_hysteresis.models.schedule import OperatingRange
from piezo_hysteresis.records.fingerprint import Fingerprint, fingerprints

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.workflow import Discovery


def final_model(found: Discovery, data: Sequence[str] = ()) -> ModelFile:
    """Return the final model with values, standard deviations and provenance."""
    final = found.final
    own = with_mean_zero(
        final.model,
        {name: final.values[name] for name in final.model.parameter_names},
        found.data.training,
        final.sampling_offset,
    )
    deviations, together = _uncertainty(found, own)
    effects = ', '.join(e.name for e in found.verdict.effects) or 'none'
    file = ModelFile(
        final.model,
        own,
        deviations,
        Provenance(
            data=tuple(data),
            date=datetime.now(UTC).isoformat(timespec='seconds'),
            fit=f'discover, baseline {found.verdict.baseline}, seed {found.verdict.seed}',
            rate=found.data.records[0].rate,
            noise_floor=found.floor,
            notes={
                'effects': effects,
                OFFSET_NOTE: float(final.sampling_offset),
                **_clock_note(found),
            },
            records=_seen(found),
            voltage=_covered(found),
        ),
        together,
        remaining_discrepancy(found),
    )
    worst = max(row.free_run_rms for row in free_runs(file, found.data.records).errors)
    return replace(file, provenance=replace(file.provenance, free_run_rms=worst))


def _clock_note(found: Discovery) -> dict[str, float]:
    """Return the note on the standard deviation of the sampling offset.

    It comes from the fit, or from the file of a baseline with the same offset.
    """
    fitted, given = found.final.fitted, found.given
    std = fitted.std.get(SAMPLING_OFFSET, inf) if fitted is not None else inf
    if given is not None and given.sampling_offset == found.final.sampling_offset:
        std = min(std, given.sampling_offset_std)
    return {OFFSET_STD_NOTE: float(std)} if np.isfinite(std) else {}


def _seen(found: Discovery) -> tuple[Fingerprint, ...]:
    """Return the records used for the model, including those of a fixed baseline."""
    before = found.given.provenance.records if found.given is not None else ()
    return tuple(dict.fromkeys((*before, *fingerprints(found.data.records))))


def _covered(found: Discovery) -> OperatingRange | None:
    """Return the voltages of the records, and of those of a fixed baseline."""
    before = found.given.provenance.voltage if found.given is not None else None
    own = OperatingRange.of(found.data.records)
    return before if own is None else own.joined(before)


def _uncertainty(
    found: Discovery, own: Mapping[str, float]
) -> tuple[dict[str, float], Correlation | None]:
    """Return standard deviations and correlation of fitted and of fixed values.

    Values that equal those of the baseline file keep their standard deviations from the file.
    """
    final = found.final
    std = final.fitted.std if final.fitted is not None else {}
    fitted = {k: v for k, v in std.items() if k in own and np.isfinite(v)}
    if found.given is not None and found.given.discrepancy is not None:
        before = found.given
        kept = {
            k: v
            for k, v in before.deviations.items()
            if own.get(k) == before.values[k] and k not in fitted
        }
        known = before.correlation
        if known is not None and not set(known.names) & set(fitted):
            return {**kept, **fitted}, Correlation.among(known.names, known.matrix, tuple(kept))
        fitted = {**kept, **fitted}
    if final.fitted is None:
        return fitted, None
    renewed = tuple(name for name in fitted if name in final.fitted.free)
    return fitted, Correlation.among(final.fitted.free, final.fitted.correlation, renewed)


def remaining_discrepancy(found: Discovery) -> Discrepancy | None:
    """Return the discrepancy of the final model by frequency, harmonic and amplitude."""
    records = {r.name: r for r in found.data.records}
    views = found.data.training
    kept = [records[view.name] for view in views]
    final = found.final
    runs = predictions(final.model, final.values, views, final.sampling_offset, checked=False)
    return discrepancy_of(map(residual_of, kept, runs), held_out=False)
