"""Identification of a model from records by any method, with uncertainty and errors."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import inf
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray, largest_if_unknown
from piezo_hysteresis.common.results import Reportable
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import IdentificationError, ModelError
from piezo_hysteresis.identification.checks import require_each_usable, require_usable
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.identification.fit import FitResult
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.inverse_fit import output_error_in_stages
from piezo_hysteresis.identification.measurement import as_measured
from piezo_hysteresis.identification.method_settings import held_at, require_settings
from piezo_hysteresis.identification.methods import (
    base_of,
    identify_by_search,
    options_implied_by,
    require_options,
)
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.noise import floor_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.online import ONLINE_METHODS, run_online
from piezo_hysteresis.identification.output_error import with_held_levels
from piezo_hysteresis.identification.prediction import with_mean_zero
from piezo_hysteresis.identification.simulate import FreeRuns, Unsaved, free_runs
from piezo_hysteresis.identification.solver import Progress
from piezo_hysteresis.identification.unseen import drop_unidentifiable, with_input_error
from piezo_hysteresis.models import Correlation, Discrepancy, Model, ModelFile, Provenance
from piezo_hysteresis.models.choice import Modelled, ModelLike, chain_of
from piezo_hysteresis.models.modelfile import (
    OFFSET_NOTE,
    OFFSET_STD_NOTE,
    parameter_columns,
    parameter_lines,
)
from piezo_hysteresis.models.schedule import OperatingRange, Schedule
from piezo_hysteresis.records import Record, listed
from piezo_hysteresis.records.fingerprint import Fingerprint, fingerprints

if TYPE_CHECKING:
    from piezo_hysteresis.identification.per_frequency import DriveFit

_INPUT_APART = (
    'the standard deviations of {method} do not contain the error of the measured voltage; those '
    'of output_error do.'
)
_MEAN_APART = 'rls does not see the mean: the offset is what its free runs miss on average.'


@dataclass(frozen=True, repr=False)
class Identification(Reportable, Modelled):
    """Result of an identification with its uncertainty.

    Attributes
    ----------
    chain : Model
        The chain of blocks.
    method : str
        One of `METHODS`.
    values : dict of str to float
        Every parameter of the chain, in SI units.
    std : dict of str to float
        Standard deviation of every fitted parameter; inf if the data do not determine it.
    names : tuple of str
        Order of `correlation`.
    correlation : ndarray, shape (p, p)
        Correlation matrix.
    condition : float
        Scaled condition number.
    converged : bool
        Whether the method converged.
    message : str
        Reason of the termination.
    warnings : tuple of str
        Warnings in sentences.
    records : tuple of RecordErrors
        One-step and free-run errors of every record.
    noise_floor : float
        Rms noise of one sample from period to period [m]; NaN if no record is periodic.
    sampling_offset : float
        Delay of the sampling of the displacement relative to the convention [s].
    sampling_offset_std : float
        Standard deviation of it [s], 0 if it was not fitted; infinite if unknown.
    history : tuple of float
        Error by iteration [m].
    seconds : float
        Run time [s].
    runs : FreeRuns
        Free runs over the fitted records.
    fit : FitResult or None
        Details of the fit, for methods that simulate.
    discrepancy : Discrepancy or None
        Model discrepancy; on the fitted records, unless others are given.
    seen : tuple of Fingerprint
        Fingerprints of the fitted records, and of those on which the discrepancy was evaluated.
    left_out : tuple of str
        Undetermined parts of the chain, in sentences: omitted blocks, held values.
    data : tuple of Record
        The fitted records.
    drives : tuple of DriveFit
        One model per drive, if asked for; errors and runs are then those of these models.
    """

    _INSTEAD: ClassVar = {
        'records[0].nrmse_percent, or to_frame()': 'rmse nrmse error errors score',
        'noise_floor': 'noise',
        'std': 'stderr deviations',
        'parameters': 'params p',
        'runs.residuals': 'residual residuals',
        'runs.simulated': 'simulated',
        'model.covariance()': 'covariance',
    }

    chain: Model
    method: str
    values: dict[str, float]
    std: dict[str, float]
    names: tuple[str, ...]
    correlation: FloatArray
    condition: float
    converged: bool
    message: str
    warnings: tuple[str, ...]
    records: tuple[RecordErrors, ...]
    noise_floor: float
    sampling_offset: float
    history: tuple[float, ...]
    seconds: float
    runs: FreeRuns = field(repr=False)
    fit: FitResult | None = field(default=None, repr=False)
    discrepancy: Discrepancy | None = field(default=None, repr=False)
    sampling_offset_std: float = inf
    seen: tuple[Fingerprint, ...] = field(default=(), repr=False)
    left_out: tuple[str, ...] = ()
    data: tuple[Record, ...] = field(default=(), repr=False)
    drives: tuple[DriveFit, ...] = ()

    def __repr__(self) -> str:
        came = 'converged' if self.converged else 'did not converge'
        lines = [f'Identification of {self.chain.name} by {self.method}, {came}']
        lines += parameter_lines(self.chain, self.values, self.std)
        worst = max(self.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
        lines.append(
            f'  free run within {1e6 * worst.free_run_rms:.3g} µm rms '
            f'({worst.nrmse_percent:.3g} %) on {counted(len(self.records), "record")}, '
            f'{counted(len(self.warnings), "warning")}{" (.warnings)" if self.warnings else ""}'
        )
        return '\n'.join(lines)

    def columns(self) -> dict[str, list[Any]]:
        """Return the parameters by column: parameter, value, std, unit, held."""
        return parameter_columns(self.chain, self.values, self.std)

    def model_file(self, data: Sequence[str] = (), rate: float | None = None) -> ModelFile:
        """Return the model as a model file.

        Parameters
        ----------
        data : sequence of str
            Names of the fitted files.
        rate : float, optional
            Sampling rate [Hz]; that of the first record by default.

        Raises
        ------
        IdentificationError
            If the model cannot be simulated with the parameters.
        """
        known = set(self.chain.parameter_names)
        finite = {k: v for k, v in self.std.items() if np.isfinite(v) and k in known}
        worst = max((r.free_run_rms for r in self.records), default=float('nan'))
        notes: dict[str, float | bool | str] = {
            OFFSET_NOTE: float(self.sampling_offset),
            'converged': self.converged,
        }
        if np.isfinite(self.sampling_offset_std):
            notes[OFFSET_STD_NOTE] = float(self.sampling_offset_std)
        if self.left_out:
            notes['left_out'] = ' '.join(self.left_out)
        provenance = Provenance(
            data=tuple(data),
            date=datetime.now(UTC).isoformat(timespec='seconds'),
            fit=f'{self.method}: {self.message}',
            rate=self.data[0].rate if rate is None and self.data else rate,
            noise_floor=self.noise_floor if np.isfinite(self.noise_floor) else None,
            free_run_rms=worst if np.isfinite(worst) else None,
            notes=notes,
            records=self.seen,
            voltage=OperatingRange.of(self.data),
        )
        try:
            together = Correlation.among(self.names, self.correlation, tuple(finite))
            return ModelFile(
                self.chain, self.values, finite, provenance, together, self.discrepancy,
                Schedule(tuple(each.point for each in self.drives)) if self.drives else None,
            )  # fmt: skip
        except ModelError as error:
            raise IdentificationError(
                f'what {self.method} found is no model that can be used ({error}); use '
                'output_error'
            ) from error

    def summary(self) -> dict[str, Any]:
        """Return the content of ``summary.json``; numbers that are not finite become null."""
        units = {q.name: q.unit for q in self.chain.parameters}
        return {
            'model': self.chain.name,
            'method': self.method,
            'parameters': {
                name: {
                    'value': float(value),
                    'std': _finite(self.std.get(name, float('nan'))),
                    'unit': units[name],
                }
                for name, value in self.values.items()
            },
            'records': [record_summary(each) for each in self.records],
            'converged': self.converged,
            'message': self.message,
            'condition': _finite(self.condition),
            'correlation': {
                'names': list(self.names),
                'matrix': [[round(float(v), 6) for v in row] for row in self.correlation],
            },
            'noise_floor_rms_m': _finite(self.noise_floor),
            'discrepancy': self.discrepancy.to_dict() if self.discrepancy else None,
            'sampling_offset_s': float(self.sampling_offset),
            'warnings': list(self.warnings),
            'seconds': self.seconds,
            **({'drives': list(map(_drive_summary, self.drives))} if self.drives else {}),
        }


def _drive_summary(drive: DriveFit) -> dict[str, Any]:
    """Return the row of ``summary.json`` of one drive."""
    point = drive.point
    return {
        'frequency_hz': point.frequency,
        'amplitude_v': point.amplitude,
        'order': point.order,
        'model': point.model.model.name,
        'converged': drive.converged,
        'free_run_rms_m': _finite(drive.rms),
        'free_run_rms_of_all_m': _finite(drive.rms_of_all),
        'free_run_rms_left_out_m': _finite(drive.rms_left_out),
        'parameters': {
            name: {'value': float(value), 'std': point.model.deviations.get(name)}
            for name, value in point.model.values.items()
        },
    }


def record_summary(errors: RecordErrors) -> dict[str, Any]:
    """Return the row of ``summary.json`` of one record."""
    return {
        'record': errors.record,
        'one_step_rms_m': _finite(errors.one_step_rms),
        'free_run_rms_m': _finite(errors.free_run_rms),
        'nrmse_percent': _finite(errors.nrmse_percent),
        'start': errors.start,
        'own_zero': errors.own_zero,
        'noise_rms_m': _finite(errors.noise_rms),
        'lost_samples': errors.lost,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


# Options of `output_error` that a further fit of its result takes.
_OF_FIT = 'priors', 'weights', 'max_evaluations', 'stopped'


def identify(
    records: Record | Sequence[Record],
    model: ModelLike,
    *,
    method: str = 'output_error',
    hold: Mapping[str, float] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int = 1,
    **options: Any,
) -> Identification:
    """Identify a model from records by any method.

    Parameters
    ----------
    records : Record or sequence of Record
        Fitted jointly (recursive methods process them in sequence).
    model : str, Path, Model, ModelFile or Identification
        Any chain for `output_error` and the searches; see `run_online` for the others. A name,
        ``NAME[+BLOCK...]``; or a model with values (or its path), from which the fit starts.
    method : str
        One of `METHODS`.
    hold : mapping of str to float, optional
        Parameters that are not fitted, with their values in SI units.
    seed : int
        Seed of the searches.
    progress : callable, optional
        Called with ``(fraction, words)``.
    workers : int
        Threads; the result does not depend on it.
    **options
        Further arguments of `output_error`, `identify_by_search` or `run_online`.

    Returns
    -------
    Identification
        Also without convergence: check `converged` and `warnings`.

    Raises
    ------
    IdentificationError
        If the records are unusable, or a setting is invalid; the message states the remedy.
    ModelError
        If there is no such model.
    """
    records = listed(records)
    base = base_of(method)
    model, known = chain_of(model)
    require_options(method, options)
    options = {**options_implied_by(method), **options}
    started = time.perf_counter()
    require_settings(
        seed=seed,
        workers=workers,
        max_evaluations=options.get('max_evaluations'),
        forgetting=options.get('forgetting'),
    )
    if known and base not in (*ONLINE_METHODS, 'output_error'):
        raise IdentificationError(f'{method} starts from no file; give the name of its model')
    if known:  # arguments override held parameters of a file
        known = {name: value for name, value in known.items() if name not in (hold or {})}
        options['start'] = {**known, **(options.get('start') or {})}
    given = dict(options.get('start') or {})
    given.pop(SAMPLING_OFFSET, None)
    model = held_at(model, hold or {}, given)
    records, remarks = as_measured(records)
    remarks += require_usable(records)
    if base in ONLINE_METHODS:
        return _online(records, model, method, remarks, started, progress, options)
    if base == 'output_error':
        fit = output_error_in_stages(model, records, workers=workers, progress=progress, **options)
        fit, left_out = drop_unidentifiable(fit, records, {**options, 'workers': workers})
    else:
        fit = identify_by_search(
            model, records, base, seed=seed, workers=workers, progress=progress, **options
        )
        left_out = ()
    choices = RecordAssumptions(options.get('begins', 'auto'), options.get('zero', 'auto'))
    if base == 'output_error':
        more = {name: options[name] for name in _OF_FIT if name in options}
        fit = with_held_levels(fit, records, choices, workers=workers, progress=progress, **more)
    fit = with_input_error(fit)
    zeroed = with_mean_zero(fit.model, fit.values, fit.targets, fit.sampling_offset)
    fit = replace(fit, values=zeroed)
    std = fit.std.get(SAMPLING_OFFSET, 0.0)
    own = Unsaved(fit.model, fit.values, fit.sampling_offset, std)
    runs = free_runs(own, records, choices, workers=workers)
    return Identification(
        chain=fit.model,
        method=method,
        values=fit.values,
        std={k: v for k, v in fit.std.items() if k in fit.values},
        names=fit.free,
        correlation=fit.correlation,
        condition=fit.condition,
        converged=fit.converged,
        message=fit.message,
        warnings=(*remarks, *left_out, *fit.warnings, *misfit_of(runs.errors)),
        records=runs.errors,
        noise_floor=floor_of(records).rms,
        sampling_offset=fit.sampling_offset,
        history=fit.history,
        seconds=time.perf_counter() - started,
        fit=fit,
        discrepancy=discrepancy_of(runs.residuals, held_out=False),
        runs=runs,
        sampling_offset_std=std,
        seen=fingerprints(records),
        left_out=left_out,
        data=tuple(records),
    )


def evaluated_on(found: Identification, records: Sequence[Record]) -> Identification:
    """Return an identification with the discrepancy on records that were not fitted."""
    records, _ = as_measured(records)
    require_each_usable(records)
    own = (found.chain, found.values, found.sampling_offset, found.sampling_offset_std)
    runs = free_runs(found.model_file() if found.drives else Unsaved(*own), records)
    left = discrepancy_of(runs.residuals, held_out=True)
    return replace(found, discrepancy=left, seen=(*found.seen, *fingerprints(records)))


def misfit_of(rows: Sequence[RecordErrors]) -> list[str]:
    """Return warnings on excluded samples, and on residuals far above the noise."""
    remarks = [
        f'record {row.record}: {counted(row.lost, "sample")} excluded from the fit as spikes or '
        'drop-outs; the stated error contains them.'
        for row in rows
        if row.lost
    ]
    worst = max(rows, key=lambda row: row.free_run_rms)
    if not np.isfinite(worst.free_run_rms):
        return [
            *remarks,
            f'the free run diverges on record {worst.record}: simulate with another method.',
        ]
    known = [row for row in rows if row.noise_rms > 0]
    if not known:
        return remarks
    worst = max(known, key=lambda row: row.free_run_rms / row.noise_rms)
    ratio = worst.free_run_rms / worst.noise_rms
    if ratio < 3:
        return remarks
    sentence = (
        f'on record {worst.record} the model misses {1e6 * worst.free_run_rms:.3g} µm, '
        f'{ratio:.0f} times the noise; standard deviations '
        'exclude this error. `discover` reports what is missing.'
    )
    return [*remarks, sentence]


def _online(
    records: Sequence[Record],
    model: Model,
    method: str,
    remarks: Sequence[str],
    started: float,
    progress: Progress | None,
    options: Mapping[str, Any],
) -> Identification:
    run = run_online(model, records, base_of(method), progress=progress, **options)
    estimate = run.estimate
    chain = model
    if 'pi_range' in model.parameter_names:
        span = max(float(np.max(np.abs(r.voltage))) for r in records)
        chain = model.hold(pi_range=span)
    values = {**chain.defaults(), **estimate.parameters()}
    std = {n: float(s) for n, s in zip(estimate.names, estimate.standard_deviations, strict=True)}
    if run.zero is not None:
        values['offset'], std['offset'] = run.zero
        remarks = (*remarks, _MEAN_APART)
    if any(each.input_uncertainty and each.input_uncertainty.rms > 0.0 for each in records):
        remarks = (*remarks, _INPUT_APART.format(method=method))
    late = run.sampling_offset
    runs = free_runs(Unsaved(chain, values, late, inf), records)
    return Identification(
        chain=chain,
        method=method,
        values=values,
        std=std,
        names=estimate.names,
        correlation=estimate.correlation,
        condition=estimate.condition_number,
        converged=run.settled,
        message='at rest' if run.settled else 'still drifting',
        warnings=(*remarks, *run.warnings, *misfit_of(runs.errors)),
        records=runs.errors,
        noise_floor=floor_of(records).rms,
        sampling_offset=late,
        history=run.history,
        seconds=time.perf_counter() - started,
        discrepancy=discrepancy_of(runs.residuals, held_out=False),
        runs=runs,
        seen=fingerprints(records),
        data=tuple(records),
    )
