"""One set of parameters and one harmonic order for each drive of the records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_hysteresis.errors import IdentificationError, PiezoError
from piezo_hysteresis.identification.identify import Identification, identify, misfit_of
from piezo_hysteresis.identification.methods import base_of
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.rls import BY_ORDER
from piezo_hysteresis.identification.simulate import drive_of, free_runs
from piezo_hysteresis.identification.solver import Progress
from piezo_hysteresis.models import Model, ModelFile, named
from piezo_hysteresis.models.choice import ModelLike, chain_of
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.numerics.harmonics import odd_oscillation
from piezo_hysteresis.records import Record, listed


@dataclass(frozen=True)
class DriveFit:
    """The fit of one drive.

    Attributes
    ----------
    point : OperatingPoint
        The drive and its model.
    converged : bool
        Whether the method converged.
    rms : float
        Rms of the free-run error of its model on its records [m].
    rms_of_all : float
        The same with one set of parameters for all records [m]; infinite if there is none.
    rms_left_out : float
        The same with the model of the nearest other frequency [m]; NaN for a single frequency.
    """

    point: OperatingPoint
    converged: bool
    rms: float
    rms_of_all: float
    rms_left_out: float


def order_of(record: Record) -> int:
    """Return the odd harmonic of a record that exceeds its hysteresis: 3, 5, or 0 for none."""
    part = record.displacement[record.warm_up_samples :]
    return odd_oscillation(part, record.info.frequency, record.dt)


def identify_per_frequency(
    records: Sequence[Record],
    model: ModelLike,
    *,
    method: str = 'output_error',
    hold: Mapping[str, float] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Identification:
    """Identify a model from all records, and one more for each drive.

    One sine determines its hysteresis but not the dynamics of the structure. The parameters of
    blocks with inertia are therefore those of all records; an autoregression of the papers belongs
    to its frequency, and the order of its model follows from the record (`order_of`).
    """
    groups = _groups(listed(records))
    model, start = chain_of(model)
    if start:
        options['start'] = {**start, **(options.get('start') or {})}
    settings: dict[str, Any] = {'method': method, 'hold': hold, **options}

    def part(done: float, share: float) -> Progress | None:
        if progress is None:
            return None
        return lambda fraction, words: progress(done + share * fraction, words)

    remarks: list[str] = []
    whole = _whole(records, model, settings, part(0.0, 0.5), remarks)
    shared = settings if whole is None else _with_structure(settings, model, whole)
    found: list[tuple[OperatingPoint, Identification]] = []
    for k, ((frequency, amplitude), group) in enumerate(groups.items()):
        try:
            fit = _fit_of(group, model, shared, part(0.5 + 0.5 * k / len(groups), 0.0))
            travel = max(0.5 * float(np.nanmax(r.displacement) - np.nanmin(r.displacement))
                         for r in group)  # fmt: skip
            point = OperatingPoint(frequency, amplitude, travel, order_of(group[0]), fit.model)
        except PiezoError as error:
            remarks.append(f'{frequency:g} Hz, {amplitude:g} V has no model of its own: {error}')
            continue
        found.append((point, fit))
    if not found:
        raise IdentificationError(f'no drive has a model: {" ".join(remarks)}')
    schedule = Schedule(tuple(point for point, _ in found))
    if whole is None:
        whole = max(found, key=lambda each: each[0].travel)[1]
    drives = tuple(
        DriveFit(
            point, fit.converged, _rms(point.model, fit.data), _rms(whole.model, fit.data),
            _rms_left_out(schedule, point, fit.data),
        )
        for point, fit in found
    )  # fmt: skip
    of_all = set(misfit_of(whole.records))
    kept = [sentence for sentence in whole.warnings if sentence not in of_all]
    whole = replace(whole, drives=drives)
    runs = free_runs(whole.model_file(), records)
    return replace(
        whole,
        runs=runs,
        records=runs.errors,
        discrepancy=discrepancy_of(runs.residuals, held_out=False),
        warnings=(*kept, *remarks, *misfit_of(runs.errors)),
        data=tuple(records),
    )


def _groups(records: Sequence[Record]) -> dict[tuple[float, float], list[Record]]:
    groups: dict[tuple[float, float], list[Record]] = {}
    for record in records:
        if not record.info.frequency > 0.0:
            raise IdentificationError(
                f'record {record.name} does not say the frequency of its drive; give --frequency, '
                'or frequency in records.yaml'
            )
        groups.setdefault(drive_of(record), []).append(record)
    return groups


def _whole(
    records: Sequence[Record],
    model: Model,
    settings: Mapping[str, Any],
    progress: Progress | None,
    remarks: list[str],
) -> Identification | None:
    """Return the identification from all records, None with a remark if it is no model."""
    try:
        found = identify(records, model, progress=progress, **settings)
        assert found.model
    except PiezoError as error:
        remarks.append(
            'one set of parameters for all frequencies is not possible, so that of the largest '
            f'displacement is used where no frequency is given: {error}'
        )
        return None
    return found


def _with_structure(
    settings: Mapping[str, Any], model: Model, whole: Identification
) -> dict[str, Any]:
    """Return the settings with the parameters of blocks with inertia from all records."""
    structure = {
        name: whole.values[name]
        for block in model.blocks
        if block.inertia
        for name in model.names_of(block).values()
    }
    if not structure:
        return dict(settings)
    key = 'start' if base_of(settings['method']) in ('rls_ud', 'pi_bank') else 'hold'
    return {**settings, key: {**(settings.get(key) or {}), **structure}}


def _fit_of(
    group: Sequence[Record], model: Model, settings: Mapping[str, Any], progress: Progress | None
) -> Identification:
    if base_of(settings['method']) == 'rls' and model.name in BY_ORDER.values():
        model = named(BY_ORDER[order_of(group[0])])
    return identify(group, model, progress=progress, **settings)


def _rms(model: ModelFile, records: Sequence[Record]) -> float:
    errors = [row.free_run_rms for row in free_runs(model, records).errors]
    return float(np.sqrt(np.mean(np.square(errors))))


def _rms_left_out(schedule: Schedule, point: OperatingPoint, records: Sequence[Record]) -> float:
    others = schedule.without(point.frequency)
    if others is None:
        return math.nan
    return _rms(others.at(point.frequency, point.amplitude).model, records)
