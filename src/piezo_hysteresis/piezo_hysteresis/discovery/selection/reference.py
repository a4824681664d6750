"""What a baseline misses on records of the actuator as it was: elsewhere that is no news."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from piezo_hysteresis.discovery.data.annotate import annotated
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.discrepancy import discrepancy_of, residuals_of
from piezo_hysteresis.identification.errors import views_of
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models import Model, ModelFile
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
    if isinstance(baseline, Model):
        file = identify(
            records, baseline, workers=workers, begins=chosen.start, zero=chosen.zero
        ).model_file()
    else:
        late = baseline.sampling_offset
        views = views_of(baseline.model, baseline.values, records, late, chosen)
        left = residuals_of(baseline.model, baseline.values, records, views, late)
        file = replace(baseline, discrepancy=discrepancy_of(left, held_out=True))
    if file.discrepancy is None:
        raise IdentificationError(
            'the reference does not move the actuator: give records of drives like those to judge'
        )
    return file
