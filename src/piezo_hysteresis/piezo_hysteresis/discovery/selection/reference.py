"""What a baseline misses on records of the actuator as it was: elsewhere that is no news.

Where the reference has the drive of a record in question, what is missed there is taken off
sample by sample, so that what both have in common cancels; elsewhere in the phase of the drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.discovery.data.annotate import annotated
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.discrepancy import discrepancy_of, residuals_of
from piezo_hysteresis.identification.errors import views_of
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.models.trace import Trace
from piezo_hysteresis.records import Record


def as_on(
    reference: Sequence[Record],
    baseline: Model | ModelFile,
    choices: Choices | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline with what it misses on reference records.

    A named model is identified on them; a file keeps its values, and its discrepancy is what it
    leaves there.

    Parameters
    ----------
    reference : sequence of Record
        Of the same actuator, before whatever changed.
    baseline : Model or ModelFile
        The model that lacks something.
    choices : Choices, optional
        What is known of how the records begin and where their zeros lie.
    workers : int
        Threads of the fit.

    Raises
    ------
    IdentificationError
        If the reference tells nothing of what the model misses.
    """
    chosen = choices or Choices()
    records = annotated(reference)
    if isinstance(baseline, ModelFile):
        file = baseline
        views = views_of(file.model, file.values, records, file.sampling_offset, chosen)
    else:
        found = identify(records, baseline, workers=workers, begins=chosen.start, zero=chosen.zero)
        file, views = found.model_file(), found.views
    left = residuals_of(file.model, file.values, records, views, file.sampling_offset)
    missed = discrepancy_of(left, held_out=file is baseline)
    if missed is None:
        raise IdentificationError(
            'the reference does not move the actuator: give records of drives like those to judge'
        )
    traces = tuple(
        Trace(each.voltage, each.error, each.dt, view.begins.kind)
        for each, view in zip(left, views, strict=True)
        if each.voltage is not None and np.all(np.isfinite(each.error))
    )
    return replace(file, discrepancy=replace(missed, traces=traces))
