"""Validation of a model on records: errors, and comparison with its known discrepancy."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from piezo_hysteresis.arrays import FloatArray, largest_if_unknown
from piezo_hysteresis.common.results import Reportable
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.identification.checks import require_each_usable
from piezo_hysteresis.identification.comparison import (
    Comparison,
    compared,
    comparison_summary,
    comparison_text,
)
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.identification.identify import record_summary
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.identification.measurement import as_measured
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.noise import floor_of
from piezo_hysteresis.identification.simulate import free_runs
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.choice import Modelled, ModelLike, with_values
from piezo_hysteresis.models.model_actions import ModelActions
from piezo_hysteresis.records import Record, listed
from piezo_hysteresis.records.fingerprint import fingerprints


@dataclass(frozen=True, repr=False)
class Validation(Reportable, Modelled):
    """The errors of a model on records.

    Attributes
    ----------
    given : ModelFile
        The given model.
    updated : ModelFile
        The same model, with its errors on these records as its discrepancy.
    records : tuple of RecordErrors
        Free-run and one-step errors of every record.
    simulated : dict of str to ndarray, shape (n,)
        Free run by record name [m].
    noise_floor : float
        Rms noise of one sample [m]; NaN if no record is periodic.
    sampling_offset : float
        Delay of the displacement samples relative to the convention of a `Record` [s].
    comparisons : tuple of Comparison
        The error on each record and the error that the discrepancy of the model predicts.
    warnings : tuple of str
        Warnings on the records.
    seconds : float
        Computing time [s].
    data : tuple of Record
        The records.
    """

    _INSTEAD: ClassVar = {
        'records[0].nrmse_percent, or to_frame()': 'rmse nrmse error errors score r2',
        'noise_floor': 'noise',
        'simulated': 'predicted',
        'data[0].displacement - simulated[data[0].name]': 'residual residuals',
    }

    given: ModelFile
    updated: ModelFile
    records: tuple[RecordErrors, ...]
    simulated: dict[str, FloatArray]
    noise_floor: float
    sampling_offset: float
    comparisons: tuple[Comparison, ...]
    warnings: tuple[str, ...]
    seconds: float
    data: tuple[Record, ...] = field(repr=False)

    def __repr__(self) -> str:
        lines = [
            f'Validation of {self.given.model.name} on {counted(len(self.records), "record")}'
        ]
        lines += [
            f'  {row.record}: free run within {1e6 * row.free_run_rms:.3g} µm rms '
            f'({row.nrmse_percent:.3g} %)'
            for row in self.records
        ]
        return '\n'.join([*lines, f'  {self.remark}'])

    @property
    def remark(self) -> str:
        """One sentence on whether the errors are larger than the discrepancy of the model."""
        return comparison_text(self.comparisons, self.given.discrepancy)

    @property
    def worst(self) -> RecordErrors:
        """The record with the largest free-run error relative to its displacement."""
        return max(self.records, key=lambda row: largest_if_unknown(row.nrmse_percent))

    def model_file(self) -> ModelFile:
        """Return the model with its errors on these records as its discrepancy."""
        return self.updated

    def columns(self) -> dict[str, list[Any]]:
        """Return the errors by column, one row per record; lengths are in metres."""
        rows = [record_summary(row) for row in self.records]
        return {name: [row[name] for row in rows] for name in rows[0]}

    def summary(self) -> dict[str, Any]:
        """Return the content of ``summary.json``; numbers that are not finite become null."""
        model = self.given.model
        return {
            'model': model.name,
            'method': 'validate',
            'parameters': {
                q.name: {
                    'value': float(self.given.values[q.name]),
                    'std': self.given.deviations.get(q.name),
                    'unit': q.unit,
                }
                for q in model.parameters
            },
            'records': [record_summary(row) for row in self.records],
            'noise_floor_rms_m': self.noise_floor if self.noise_floor > 0 else None,
            'sampling_offset_s': self.sampling_offset,
            'discrepancy': comparison_summary(self.comparisons, self.given.discrepancy),
            'warnings': list(self.warnings),
            'seconds': self.seconds,
        }


def validate(
    records: Record | Sequence[Record],
    model: ModelLike,
    *,
    begins: str = 'auto',
    zero: str = 'auto',
) -> Validation:
    """Compare a model with records in free run, without fitting it to them.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of one actuator, preferably records that were not fitted.
    model : str, Path, ModelFile, Identification or Discovery
        A model with values, the path of a ``model.yaml``, or a result that contains a model.
    begins : str
        Initial condition: ``auto``, ``rest``, ``step``, ``settled`` or ``estimate``.
    zero : str
        Zero of the displacement: ``record``, ``common`` or ``auto``.

    Returns
    -------
    Validation
        Errors by record, in metres and in per cent of the displacement.

    Raises
    ------
    ModelError
        If there is no such model, or its values are not known.
    RecordError
        If there is no record, or `records` are not records.
    IdentificationError
        If a record is unusable, for the same reasons as in a fit.
    """
    started = time.perf_counter()
    if isinstance(records, ModelActions):
        raise RecordError('the records come first: validate(records, model)')
    records = listed(records)
    if not records:
        raise RecordError('there is no record to validate with; give at least one')
    given = with_values(model)
    records, warnings = as_measured(records)
    warnings += require_each_usable(records)
    runs = free_runs(given, records, Choices(begins, zero))
    left = runs.residuals
    known = compared(left, given.discrepancy) if given.discrepancy is not None else []
    seen = (*given.provenance.records, *fingerprints(records))
    updated = replace(
        given,
        discrepancy=discrepancy_of(left, held_out=True),
        provenance=replace(given.provenance, records=seen),
    )
    return Validation(
        given=given,
        updated=updated,
        records=runs.errors,
        simulated=runs.simulated,
        noise_floor=floor_of(records).rms,
        sampling_offset=runs.sampling_offset,
        comparisons=tuple(known),
        warnings=tuple(warnings),
        seconds=time.perf_counter() - started,
        data=tuple(records),
    )
