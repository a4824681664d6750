"""Recursive methods run over records, and by name for nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit import FARTHEST
from piezo_hysteresis.identification.free_run import shifted
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.recursion import Estimate, OnlineMethod, OnlineSettings
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.identification.rls_ud import OnlineBank, OnlineUd, UdSettings
from piezo_hysteresis.identification.solver import Progress
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.named import BANK, ONLINE
from piezo_hysteresis.records import Record

# Steps of the sampling offset [samples], and the relative improvement that a new one must give.
_CLOCK_STEPS = (1.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
_CLOCK_GAIN = 0.02

# Models of the papers' RLS: their harmonic, and the variants that identify them, default first.
_BY_RLS = {
    'extended': (0, ('V1', 'V2')),
    'enhanced3': (3, ('V1',)),
    'enhanced5': (5, ('V1',)),
    'extended_free': (0, ('V0',)),
    'classical': (0, ('basic',)),
    'classical_euler': (0, ('basic',)),
}

RECURSIONS: dict[str, type[OnlineMethod]] = {
    'rls': OnlineRls,
    'rls_ud': OnlineUd,
    'pi_bank': OnlineBank,
}
ONLINE_METHODS = tuple(RECURSIONS)


def online(method: str, settings: OnlineSettings | None = None) -> OnlineMethod:
    """Return the recursive method called `method`.

    Parameters
    ----------
    method : str
        ``rls``, ``rls_ud`` or ``pi_bank``.
    settings : RlsSettings or UdSettings, optional
        Settings of the method; default: its defaults.

    Raises
    ------
    IdentificationError
        If there is no such method, or the settings belong to another.
    """
    if method not in RECURSIONS:
        raise IdentificationError(
            f'{method!r} is no recursive method{choices(method, ONLINE_METHODS)}'
        )
    return RECURSIONS[method](settings)


@dataclass(frozen=True)
class OnlineRun:
    """Result of a recursive method."""

    estimate: Estimate  # after the last sample
    warnings: tuple[str, ...]  # warnings for the user
    settled: bool  # whether the estimate was stationary over the last tenth of the data
    history: tuple[float, ...]  # rms of the prediction error over each tenth of the data [m]
    # mean over the records of their mean free-run errors, and its standard deviation between
    # records, inf for one record [m]
    zero: tuple[float, float] | None = None
    sampling_offset: float = 0.0  # [s]


def run_online(
    model: Model,
    records: Sequence[Record],
    method: str,
    *,
    sampling_offset: bool = True,
    progress: Progress | None = None,
    **options: Any,
) -> OnlineRun:
    """Run a recursive method over a sequence of records, each from rest.

    A recursion assumes a given sampling offset, so it is repeated with shifted displacements, and
    the offset with the smallest prediction error is selected.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if 'natural_frequency' in model.parameter_names:
        given['start'] = _with_mode(records, given.get('start', {}))

    # without a mode it takes voltage and displacement of one tick together
    ahead = 1.0 if model.answers_at_once else 0.0

    def run(late: float) -> tuple[float, OnlineRun]:
        seen, report = records, progress
        if late != 0.0:
            earlier = (shifted(record.displacement, -late) for record in records)
            seen = [replace(r, displacement=y) for r, y in zip(records, earlier, strict=True)]
            report = None
        found = _run_on_clock(model, seen, method, report, **given)
        last = found.history[len(found.history) // 2 :]
        error = float(np.sqrt(np.mean(np.square(last))))
        late_s = (late + ahead) * records[0].dt
        return error, replace(found, sampling_offset=late_s)

    best = trusted = run(0.0)
    # the autoregression of rls absorbs the sampling offset: as printed
    if method == 'rls' or not sampling_offset:
        return trusted[1]
    at = 0.0
    for step in _CLOCK_STEPS:
        tried = [(run(at + way), at + way) for way in (-step, step) if abs(at + way) <= FARTHEST]
        for found, late in tried:
            if found[0] < best[0]:
                best, at = found, late
    return best[1] if best[0] < (1.0 - _CLOCK_GAIN) * trusted[0] else trusted[1]


def _run_on_clock(
    model: Model,
    records: Sequence[Record],
    method: str,
    progress: Progress | None,
    *,
    offset: bool = True,
    **given: Any,
) -> OnlineRun:
    """Run a recursive method over records with a known sampling offset, see `run_online`."""
    if len({record.dt for record in records}) > 1:
        raise IdentificationError(
            f'{method} needs records of one sampling rate; resample them, or use output_error'
        )
    recursion, remarks = (_papers if method == 'rls' else _well_posed)(
        model, records, method, given
    )
    total = sum(len(record) for record in records)
    done, history = 0, []
    before = recursion.estimate()
    for record in records:
        recursion.rest()
        recursion.drive_at(record.info.frequency, record.start)
        for piece in np.array_split(np.arange(len(record)), 10):
            errors = recursion.update_many(record.voltage[piece], record.displacement[piece])
            if done < 0.9 * total:
                before = recursion.estimate()
            done += piece.size
            history.append(float(np.sqrt(np.nanmean(errors**2))))
            if progress is not None:
                progress(done / total, f'prediction error {1e6 * history[-1]:.4g} µm')
    after = recursion.estimate()
    zero = _zero(recursion, records) if method == 'rls' and offset else None
    at_rest = settled(before, after)
    if not at_rest:
        remarks = (
            *remarks,
            'the estimates still drift at the end: record longer, or use output_error.',
        )
    return OnlineRun(after, (*remarks, *after.notes), at_rest, tuple(history), zero)


def _zero(recursion: OnlineMethod, records: Sequence[Record]) -> tuple[float, float]:
    """Return the offset from the free runs of the RLS of the papers.

    Their mean is A0 over beta with the rounding of both; a constant regressor in addition to A0
    does not correct this, because the two are equivalent in steady state.
    """
    missed = []
    for record in records:
        recursion.drive_at(record.info.frequency, record.start)
        with np.errstate(over='ignore', invalid='ignore'):
            error = record.displacement - recursion.free_run(record.voltage)
        part = error[record.warm_up_samples :]
        if not np.all(np.isfinite(part[np.isfinite(record.displacement[-part.size :])])):
            raise IdentificationError(
                f'rls diverges on record {record.name}: the model that it found grows without '
                'bound when it runs freely; record longer, or use output_error'
            )
        missed.append(float(np.nanmean(part)))
    spread = float(np.std(missed, ddof=1)) if len(missed) > 1 else float('inf')
    return float(np.mean(missed)), spread


def _with_mode(records: Sequence[Record], start: Mapping[str, float]) -> Mapping[str, float]:
    """Return `start` with a mode, by default that of an output-error fit."""
    if 'natural_frequency' in start:
        return start
    found = output_error(named('bouc_wen_mode'), records).values
    return {**start, **{k: found[k] for k in ('natural_frequency', 'damping_ratio')}}


def settled(before: Estimate, after: Estimate) -> bool:
    """Return whether an estimate was stationary, within its scatter or 1 % of its values."""
    moved = np.abs(after.values - before.values)
    return bool(
        np.all(moved <= np.maximum(3 * after.standard_deviations, 0.01 * np.abs(after.values)))
    )


def _papers(
    model: Model, records: Sequence[Record], method: str, given: Mapping[str, Any]
) -> tuple[OnlineMethod, tuple[str, ...]]:
    harmonic, variants = _BY_RLS.get(model.name, (0, (RlsSettings.variant,)))
    settings = RlsSettings(**{'variant': variants[0], **given, 'dt': records[0].dt})
    if model.name not in _BY_RLS:
        raise IdentificationError(
            f'rls identifies {", ".join(_BY_RLS)}, not {model.name}; use output_error'
        )
    if settings.variant not in variants:
        fitting = ', '.join(name for name, row in _BY_RLS.items() if settings.variant in row[1])
        raise IdentificationError(
            f'variant {settings.variant} identifies {fitting}, not {model.name}; its variant is '
            f'{" or ".join(variants)}'
        )
    for record in records:
        if harmonic and record.info.frequency <= 0.0:
            raise IdentificationError(
                f'record {record.name} does not say the frequency of its drive, of which '
                f'{model.name} takes a harmonic; give --frequency, or frequency in records.yaml'
            )
    first = records[0].info.frequency
    return online(method, replace(settings, harmonic=harmonic, frequency=first)), ()


def _well_posed(
    model: Model, records: Sequence[Record], method: str, given: Mapping[str, Any]
) -> tuple[OnlineMethod, tuple[str, ...]]:
    blocks = tuple(block.name for block in model.blocks)
    if blocks not in ONLINE[method]:
        fitting = {'rls_ud': 'classical or bouc_wen_mode', 'pi_bank': BANK}
        raise IdentificationError(
            f'{method} identifies {fitting[method]}, not {model.name}; use output_error'
        )
    remarks: tuple[str, ...] = ()
    frequency, damping = UdSettings.natural_frequency, UdSettings.damping_ratio
    if 'natural_frequency' in model.parameter_names:
        frequency = given['start']['natural_frequency']
        damping = given['start'].get('damping_ratio', damping)
        remarks = (f'the mode is frozen at {frequency:.4g} Hz, damping ratio {damping:.3g}.',)
    settings = UdSettings(
        voltage_range=max(float(np.max(np.abs(r.voltage))) for r in records),
        displacement_range=max(float(np.ptp(r.displacement)) for r in records) / 2,
        natural_frequency=frequency,
        damping_ratio=damping,
        forgetting=given.get('forgetting', UdSettings.forgetting),
        dt=records[0].dt,
    )
    return online(method, settings), remarks
