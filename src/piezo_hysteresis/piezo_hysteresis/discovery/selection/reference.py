"""Discrepancy of a baseline from reference records of the unchanged actuator.

If a reference record has the same drive as a tested record, the reference residual is subtracted
sample by sample, so that the common part cancels; otherwise it is subtracted in phase with the
drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.simulate import free_runs
from piezo_hysteresis.models import Discrepancy, Model, ModelFile
from piezo_hysteresis.models.repeated_records import Support, kinds_of, support_of
from piezo_hysteresis.models.repeating import Trace
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.fingerprint import fingerprints, recognised

# Ratio of the strokes at one drive from which repeats are of two actuators.
_STROKES = 2.0


def as_on(
    reference: Sequence[Record],
    baseline: Model | ModelFile,
    choices: Choices | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline as a model file with its discrepancy on reference records.

    A named model is identified on these records. A file keeps its values, and its discrepancy is
    the residual on these records.
    """
    file, missed = _missed(annotated(reference), baseline, choices or Choices(), workers)
    return replace(file, discrepancy=missed)


def with_repeats(
    repeats: Sequence[Record],
    baseline: Model | ModelFile,
    choices: Choices | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline as a model file that knows how much unchanged records differ.

    A named model is identified on these records. To those of a file they are added, except for
    the ones that it was identified from. New records are not judged if they are among them.
    """
    records = list(annotated(repeats))
    _require_single(records)
    known = baseline.discrepancy if isinstance(baseline, ModelFile) else None
    if isinstance(baseline, ModelFile):
        own = recognised(records, baseline.provenance.records)
        records = [record for record in records if record.name not in own]
    if isinstance(baseline, ModelFile) and not records:
        file, missed = baseline, known
    else:
        file, missed = _missed(records, baseline, choices or Choices(), workers)
    if known is not None and missed is not None and missed is not known:
        rows, traces = (*known.conditions, *missed.conditions), (*known.traces, *missed.traces)
        missed = replace(missed, conditions=rows, traces=traces)
    if missed is None or all(each.records == 1 for each in missed.kinds):
        raise IdentificationError(
            'the repeats hold no two records of the same drive: give at least two of one '
            'experiment, with nothing changed in between'
        )
    _require_one_actuator(missed)
    seen = (*file.provenance.records, *fingerprints(records))
    return replace(file, discrepancy=missed, provenance=replace(file.provenance, records=seen))


def _require_single(records: Sequence[Record]) -> None:
    """Reject a run that is given twice: p counts runs."""
    seen = fingerprints(records)
    for k, record in enumerate(records):
        same = [records[j].name for j in range(k) if seen[j].is_of(record)]
        if same:
            raise IdentificationError(
                f'the repeats {same[0]} and {record.name} are one run; give each once'
            )


def _require_one_actuator(missed: Discrepancy) -> None:
    """Reject repeats of one drive whose strokes differ as those of two actuators or units do."""
    for rows in kinds_of(missed.conditions):
        least, most = (f(each.stroke for each in rows) for f in (min, max))
        if most > _STROKES * least:
            raise IdentificationError(
                f'the repeats move {1e6 * least:.3g} and {1e6 * most:.3g} µm at the same drive: '
                'another actuator, or another unit; give runs with nothing changed in between'
            )


def _missed(
    records: Sequence[Record], baseline: Model | ModelFile, choices: Choices, workers: int
) -> tuple[ModelFile, Discrepancy]:
    """Return a baseline as a model file, and its discrepancy on records."""
    if isinstance(baseline, ModelFile):
        file = baseline
        runs = free_runs(file, records, choices)
    else:
        found = identify(
            records, baseline, workers=workers, begins=choices.start, zero=choices.zero
        )
        file, runs = found.model, found.runs
    left, views = runs.residuals, runs.views
    missed = discrepancy_of(left, held_out=file is baseline)
    if missed is None:
        raise IdentificationError(
            'the reference does not move the actuator: give records of similar drives'
        )
    traces = tuple(
        Trace(each.voltage, each.error, each.dt, view.begins.kind)
        for each, view in zip(left, views, strict=True)
        if each.voltage is not None and np.all(np.isfinite(each.error))
    )
    return file, replace(missed, traces=traces)


def support_for(
    records: Sequence[Record], file: ModelFile, choices: Choices | None = None
) -> Support | None:
    """Return what the untouched records of a file say on new records; None without repeats."""
    known = file.discrepancy
    if known is None or all(each.records == 1 for each in known.kinds):
        return None
    new = discrepancy_of(free_runs(file, records, choices).residuals, held_out=True)
    return None if new is None else support_of(new.conditions, known.conditions)
