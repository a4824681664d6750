"""Discrepancy of a baseline from reference records of the unchanged actuator.

If a reference record has the same drive as a tested record, the reference residual is subtracted
sample by sample, so that the common part cancels; otherwise it is subtracted in phase with the
drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.discovery.data.annotate import annotated
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.simulate import free_runs
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.models.trace import Trace
from piezo_hysteresis.records import Record


def as_on(
    reference: Sequence[Record],
    baseline: Model | ModelFile,
    choices: Choices | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline as a model file with its discrepancy on reference records.

    A named model is identified on these records. A file keeps its values, and its discrepancy is
    the residual on these records.

    Parameters
    ----------
    reference : sequence of Record
        Records of the same actuator before the change.
    baseline : Model or ModelFile
        The model that is tested for missing effects.
    choices : Choices, optional
        Known initial conditions and zero offsets of the records.
    workers : int
        Number of threads of the fit.

    Raises
    ------
    IdentificationError
        If no discrepancy can be computed from the reference.
    """
    chosen = choices or Choices()
    records = annotated(reference)
    if isinstance(baseline, ModelFile):
        file = baseline
        runs = free_runs(file, records, chosen)
    else:
        found = identify(records, baseline, workers=workers, begins=chosen.start, zero=chosen.zero)
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
    return replace(file, discrepancy=replace(missed, traces=traces))
