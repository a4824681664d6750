"""The free run of an identified model over a record."""

from __future__ import annotations

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.errors import free_run_of, views_of
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record


def simulate(model: Identification | ModelFile, record: Record) -> FloatArray:
    """Return the free run of a model over a record.

    Parameters
    ----------
    model : Identification or ModelFile
        With its values and its sampling offset.
    record : Record
        Gives the voltage, and with the displacement the state from which the run begins.

    Returns
    -------
    ndarray, shape (n,)
        Displacement [m], in the zero of the record.

    Raises
    ------
    IdentificationError
        If something else is given.
    """
    if not isinstance(model, (Identification, ModelFile)):
        raise IdentificationError(
            'simulate takes what identify returned or a ModelFile, not of type '
            f'{type(model).__name__}; `ModelFile.load` reads a model.yaml'
        )
    if not isinstance(record, Record):
        raise IdentificationError(
            f'simulate takes one Record, not of type {type(record).__name__}'
        )
    late = model.sampling_offset
    (view,) = views_of(model.model, model.values, [record], late)
    return free_run_of(model.model, model.values, view, late)
