"""The free run of a model with values over records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.records import Record, listed


@overload
def simulate(model: ModelLike, records: Record) -> FloatArray: ...
@overload
def simulate(model: ModelLike, records: Sequence[Record]) -> list[FloatArray]: ...
def simulate(
    model: ModelLike, records: Record | Sequence[Record]
) -> FloatArray | list[FloatArray]:
    """Return the free run of a model over records, comparable with their displacement.

    The run gets the voltage of a record alone. Its state before the first sample, its zero and
    the sampling offset are those of the measurement; `ModelFile.simulate` starts from rest.

    Parameters
    ----------
    model : str, Path, ModelFile, Identification or Discovery
        A model with values, the path of a ``model.yaml``, or a result that contains a model.
    records : Record or sequence of Record
        Voltage and displacement.

    Returns
    -------
    ndarray, shape (n,), or list of ndarray
        Displacement [m] of the record, or of each record in order.

    Raises
    ------
    ModelError
        If there is no such model, or its values are not known.
    RecordError
        If `records` are not records.
    """
    given = with_values(model)
    late = given.sampling_offset
    views = views_of(given.model, given.values, listed(records), late)
    runs = [each.displacement for each in predictions(given.model, given.values, views, late)]
    return runs[0] if isinstance(records, Record) else runs
