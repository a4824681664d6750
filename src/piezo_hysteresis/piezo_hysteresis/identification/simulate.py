"""Simulation of new records by a model file, and their sampling offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, overload

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification.error_measures import RecordErrors, errors_in, views_of
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.measurement import as_measured
from piezo_hysteresis.identification.model_discrepancy import RecordResidual, residual_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.records import Record, listed

#: Difference of the sampling offset between two recordings of one set-up, as a share of a sample:
#: a driver that reads and writes in every tick does both within a tenth of it.
JITTER = 0.1
# Standard deviations of the identified offset that are added to it, and the upper limit of the sum
# as a share of a sample: beyond half a sample the next sample is nearer.
_DEVIATIONS = 2.0
_MOST = 0.5


class Unsaved(NamedTuple):
    """A model with its clock that is no file, since its values may be invalid."""

    model: Model
    values: Mapping[str, float]
    sampling_offset: float
    sampling_offset_std: float


def clock_about(
    given: ModelFile | Unsaved, dt: float, jitter: float = JITTER
) -> tuple[float, float]:  # dt [s]; jitter [1]
    """Return the range of the sampling offset of new records [s].

    At most half a sample, because sample numbers count whole samples. The full half sample is
    allowed where a chain without inertia has a fitted offset: it then represents dynamics faster
    than a sample, which are not distinguishable from a sampling offset.
    """
    known = _DEVIATIONS * given.sampling_offset_std / dt
    part = given.sampling_offset_std > 0.0 and given.model.answers_at_once
    reach = (_MOST if part else min(jitter + known, _MOST)) * dt
    return given.sampling_offset - reach, given.sampling_offset + reach


def clock_of(given: ModelFile | Unsaved, views: Sequence[FitData]) -> float:
    """Return the sampling offset at which a model fits the records best [s].

    It is within `clock_about`. The identified offset is returned if the model cannot be
    simulated.
    """
    bounds = clock_about(given, min(view.dt for view in views))
    found = fit(
        given.model,
        (),
        {**given.values, SAMPLING_OFFSET: given.sampling_offset},
        free=(),
        targets=views,
        sampling_offset=True,
        bounds={SAMPLING_OFFSET: bounds},
        max_evaluations=20,
    )
    late = found.sampling_offset
    return late if found.residuals and np.isfinite(late) else given.sampling_offset


@dataclass(frozen=True)
class FreeRuns:
    """Free runs of one model over records of one recording.

    Attributes
    ----------
    views : tuple of FitData
        The records with their initial conditions and zeros.
    sampling_offset : float
        Delay of the displacement samples relative to the convention of a `Record` [s].
    errors : tuple of RecordErrors
        Errors by record.
    residuals : tuple of RecordResidual
        Measured minus simulated, by record.
    simulated : dict of str to ndarray, shape (n,)
        Displacement by record name [m].
    """

    views: tuple[FitData, ...]
    sampling_offset: float
    errors: tuple[RecordErrors, ...]
    residuals: tuple[RecordResidual, ...]
    simulated: dict[str, FloatArray]


def free_runs(
    given: ModelFile | Unsaved,
    records: Sequence[Record],
    choices: RecordAssumptions | None = None,
    *,
    workers: int = 1,
) -> FreeRuns:
    """Return the free runs of a model over records, with initial states, zeros and clock.

    A model with values outside of their range, such as an unstable recursion, runs from rest.
    """
    if isinstance(given, ModelFile) and given.schedule is not None:
        return _scheduled_runs(given, records, choices, workers)
    model, values, late = given.model, given.values, given.sampling_offset
    usable = _is_usable(model, values)
    views = views_of(model, values, records, late, choices, checked=usable, workers=workers)
    if usable:
        late = clock_of(given, views)
    errors, residuals, simulated = [], [], {}
    found = predictions(model, values, views, late, checked=usable)
    for record, each in zip(records, found, strict=True):
        errors.append(errors_in(model, values, each))
        residuals.append(residual_of(record, each))
        simulated[record.name] = each.displacement
    return FreeRuns(views, late, tuple(errors), tuple(residuals), simulated)


def drive_of(record: Record) -> tuple[float, float]:
    """Return the frequency [Hz] of the drive of a record, 0 for none, and its amplitude [V]."""
    stated = record.info.amplitude
    amplitude = stated if stated > 0.0 else 0.5 * float(np.ptp(record.voltage))
    return record.info.frequency, float(f'{amplitude:.3g}')


def entry_for(given: ModelFile, records: Sequence[Record]) -> ModelFile:
    """Return the entry of the schedule of all records; a model without one as it is."""
    found = {id(own): own for own in (given.at(*drive_of(record)) for record in records)}
    if given.schedule is None:
        return given
    if len(found) != 1:
        raise ModelError(
            f'{given.model.name} has a set of parameters per drive, and the records are of '
            f'{len(found)} of them; give the records of one drive, or a model that was identified '
            'without --per-frequency'
        )
    return replace(next(iter(found.values())), schedule=None)


def _scheduled_runs(
    given: ModelFile, records: Sequence[Record], choices: RecordAssumptions | None, workers: int
) -> FreeRuns:
    """Return the free runs of the entry of each record."""
    groups: dict[int, tuple[ModelFile, list[Record]]] = {}
    for record in records:
        frequency, amplitude = drive_of(record)
        own = given.at(frequency, amplitude)
        groups.setdefault(id(own), (replace(own, schedule=None), []))[1].append(record)
    found = {}
    offsets = []
    for own, group in groups.values():
        runs = free_runs(own, group, choices, workers=workers)
        offsets.append(runs.sampling_offset)
        for k, record in enumerate(group):
            found[record.name] = runs.views[k], runs.errors[k], runs.residuals[k], runs.simulated
    views, errors, residuals, simulated = zip(*(found[r.name] for r in records), strict=True)
    names = [record.name for record in records]
    return FreeRuns(
        views, float(np.median(offsets)), errors, residuals,
        {name: each[name] for name, each in zip(names, simulated, strict=True)},
    )  # fmt: skip


def _is_usable(model: Model, values: Mapping[str, float]) -> bool:
    try:
        model.pack(values)
    except ModelError:
        return False
    return True


@overload
def simulate(
    model: ModelLike, records: Record, *, begins: str = 'auto', zero: str = 'auto'
) -> FloatArray: ...
@overload
def simulate(
    model: ModelLike, records: Sequence[Record], *, begins: str = 'auto', zero: str = 'auto'
) -> list[FloatArray]: ...
def simulate(
    model: ModelLike,
    records: Record | Sequence[Record],
    *,
    begins: str = 'auto',
    zero: str = 'auto',
) -> FloatArray | list[FloatArray]:
    """Return the free run of a model over records, comparable with their displacement.

    The run gets the voltage of a record alone. Its state before the first sample, its zero and
    the sampling offset are those of the measurement; `ModelFile.simulate` starts from rest. The
    errors that `identify`, `validate` and `discover` state are those of this run.

    Parameters
    ----------
    model : str, Path, ModelFile, Identification or Discovery
        A model with values, the path of a ``model.yaml``, or a result that contains a model.
    records : Record or sequence of Record
        Voltage and displacement; a sequence is one recording with one sampling offset.
    begins : str
        Initial condition: ``auto``, ``rest``, ``step``, ``settled`` or ``estimate``.
    zero : str
        Zero of the displacement: ``record``, ``common`` or ``auto``.

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
    usable, _ = as_measured(listed(records), all_kept=True)
    runs = free_runs(given, usable, RecordAssumptions(begins, zero)).simulated
    found = [runs[record.name] for record in usable]
    return found[0] if isinstance(records, Record) else found
