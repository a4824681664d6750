"""How a record was measured: error of the input, readings out of range, steps of a counter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.identification.input_error import (
    NEGLIGIBLE,
    ON_GRID,
    SLOW,
    InputError,
    input_error,
)
from piezo_hysteresis.identification.noise import differences_noise, steps_of, stroke_of
from piezo_hysteresis.identification.outliers import interpolated, out_of_range, without_steps
from piezo_hysteresis.identification.periods import cached_per_record
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.record import InputUncertainty

# Ranges over the largest below which a drive may be an error, and its share of the motion of a
# drive; error over the range from which an input is unknown.
_SMALL, _FOLLOWED, _UNKNOWN = 0.1, 0.3, 0.02
# Ratio of the size of a line of a record to those of others, within which it is the same hum.
_SIZE = 1.5
_PARTS = 16  # whose means show the error of the mean
_LEFT_OUT = (
    'record {record} is left out: its voltage was measured too slowly or with too much noise, and '
    'is known to {share:.2g} % of its range only. Log the command'
)
_SKIPPED = (
    'record {record} is left out: its voltage was held for {hold} samples and moved faster, so '
    'that what it did between two readings is not known. Log the command'
)
_REST = (
    'record {record}: the voltage was measured, not commanded: the displacement does not follow '
    'its changes, so it is taken as constant'
)


def measurement_findings(record: Record) -> list[str]:
    """Return sentences on the input, on readings out of range and on steps of the counter."""
    return [*_input(record), *_codes(record), *_steps(record)]


def as_measured(
    records: Sequence[Record], *, all_kept: bool = False
) -> tuple[list[Record], list[str]]:
    """Return records for a fit, and sentences on what was found wrong with their measurement.

    Readings out of range are interpolated: there was no measurement. Noise, steps, hold and hum of
    a recorded input are removed; what remains is stated in its metadata. A record of a set whose
    input is hardly known is left out, unless `all_kept`.
    """
    remarks = [
        f'record {record.name}: {sentence}'
        for record in records
        for sentence in measurement_findings(record)
    ]
    found = [_usable(record) for record in records]
    if len(found) < 2:
        return found, remarks
    found, more = _in_a_set(records, found, all_kept)
    return found, [*remarks, *more]


def _in_a_set(
    records: Sequence[Record], found: Sequence[Record], all_kept: bool
) -> tuple[list[Record], list[str]]:
    """Return records with what the other ones show of their input, and sentences on that."""
    largest = max(found, key=lambda record: float(np.ptp(record.voltage)))
    errors = [error for error in map(_error_of, records) if error is not None]
    step = max((error.step for error in errors), default=0.0)
    noises = [error.rms for error in errors if error.hold == 1]
    noise = float(np.median(noises)) if 2 * len(noises) > len(found) else 0.0
    kept, remarks = [], []
    hum = _hum_of(errors)
    for original, record in zip(records, found, strict=True):
        measured = _error_of(original)
        record, removed = _without_hum(record, measured, hum)
        remarks += removed
        rest, error = _at_rest(record, largest), record.input_uncertainty
        if rest is not None:
            remarks.append(_REST.format(record=record.name))
        elif measured is not None and measured.skipped and not all_kept:
            remarks.append(_SKIPPED.format(record=record.name, hold=measured.hold))
            continue
        elif (
            error is not None
            and error.rms > _UNKNOWN * float(np.ptp(record.voltage)) > 0.0
            and not all_kept
        ):
            share = 100.0 * error.rms / float(np.ptp(record.voltage))
            remarks.append(_LEFT_OUT.format(record=record.name, share=share))
            continue
        elif error is None and step and _on_grid(record.voltage, step):
            rounding = InputUncertainty(step / sqrt(12.0), SLOW)
            rest = replace(record, input_uncertainty=rounding)
        elif error is None and noise:  # the same instrument, and a drive as fast as its noise
            own = differences_noise(record.voltage).rms
            if own > 0.0:
                rest = replace(record, input_uncertainty=InputUncertainty(min(noise, own)))
        kept.append(record if rest is None else rest)
    return (kept, remarks) if kept else (list(found), remarks)


def _hum_of(errors: Sequence[InputError]) -> list[tuple[float, float, float]]:
    """Return frequency, least and largest amplitude of each mains line of several records."""
    lines: dict[int, list[tuple[float, float]]] = {}
    for error in errors:
        for frequency, size in error.hum:
            lines.setdefault(round(frequency), []).append((frequency, size))
    found = []
    for each in lines.values():
        sizes = [size for _, size in each]
        found.append((float(np.median([f for f, _ in each])), min(sizes), max(sizes)))
    return found


def _without_hum(
    record: Record, error: InputError | None, hum: Sequence[tuple[float, float, float]]
) -> tuple[Record, list[str]]:
    """Return a record without the lines that other records of its instrument have, and sentences.

    Alone, hum at a harmonic of the drive or near it looks like drive. A line of a drive is of
    another size.
    """
    own = {round(frequency) for frequency, _ in (error.hum if error is not None else ())}
    remarks = []
    for frequency, least, most in hum:
        if round(frequency) in own or not frequency * record.dt < 0.5:
            continue
        u, window = record.voltage, np.hanning(len(record))
        wave = np.exp(2j * np.pi * frequency * record.dt * np.arange(u.size))
        line = 2.0 * complex(np.sum(window * (u - u.mean()) * wave.conj())) / float(window.sum())
        if not least / _SIZE < abs(line) < _SIZE * most:
            continue
        record = replace(record, voltage=u - np.real(line * wave))
        kind, unit = record.info.input_name, record.info.input_unit
        remarks.append(
            f'record {record.name}: a line of {abs(line):.2g} {unit} at {frequency:.4g} Hz in the '
            f'{kind}, as in the other records, is hum and is removed'
        )
    return record, remarks


def _on_grid(u: FloatArray, step: float) -> bool:
    place = (u - u.min()) / step
    return bool(np.all(np.abs(place - np.rint(place)) < ON_GRID))


def _at_rest(record: Record, largest: Record) -> Record | None:
    """Return a record with a constant input, if its changes are an error; else None.

    The witness is the displacement: of a drive it has the share that `largest` has.
    """
    u, y = record.voltage, record.displacement
    reach = float(np.ptp(largest.voltage))
    if not 0.0 < float(np.ptp(u)) < _SMALL * reach:
        return None
    # the displacement at rest drifts or creeps
    basis = np.vander(np.linspace(-1.0, 1.0, u.size), 3)
    rest = [each - basis @ solve_least_squares(basis, each).values for each in (u, y)]
    power = inner(rest[0], rest[0])
    share = inner(rest[0], rest[1]) / max(power, 1e-300)
    deviation = float(np.std(rest[1] - share * rest[0])) / sqrt(max(power, 1e-300))
    gain = stroke_of(largest) / reach
    if share + 3.0 * deviation > _FOLLOWED * gain:
        return None
    mean = float(np.mean(u))
    means = [float(np.mean(part)) for part in np.array_split(u, _PARTS)]
    error = float(np.std(means)) / sqrt(_PARTS)
    uncertainty = InputUncertainty(error, term=error)
    return replace(record, voltage=np.full(u.size, mean), input_uncertainty=uncertainty)


@cached_per_record
def _out_of_range(record: Record) -> BoolArray:
    return out_of_range(record.voltage, record.displacement)


@cached_per_record
def _usable(record: Record) -> Record:
    out = _out_of_range(record)
    if np.any(out):
        record = replace(record, displacement=interpolated(record.displacement, out))
    error = _error_of(record)
    if error is None:
        return record
    return replace(record, voltage=error.voltage, input_uncertainty=error.left)


@cached_per_record
def _error_of(record: Record) -> InputError | None:
    if record.input_uncertainty is not None:
        return None
    out = _out_of_range(record)
    return input_error(record.voltage, interpolated(record.displacement, out), record.dt)


def _input(record: Record) -> list[str]:
    error = _error_of(record)
    if error is None or not error.rms > NEGLIGIBLE * float(np.ptp(record.voltage)):
        return []
    kind, unit = record.info.input_name, record.info.input_unit
    reach = float(np.ptp(error.voltage))
    sentence = f'the {kind} was measured, not commanded: its error is {error.words(unit)}; '
    if not reach > 0.0:
        return [sentence + 'nothing else moves it, so it is taken as constant']
    hidden = 1e6 * stroke_of(record) / reach * error.left.rms
    sentence += (
        f'{error.left.rms:.2g} {unit} of it cannot be removed, which hides {hidden:.2g} µm of '
        'displacement. Log the command, or average several runs'
    )
    return [sentence]


def _codes(record: Record) -> list[str]:
    y, out = record.displacement, _out_of_range(record)
    if not np.any(out):
        return []
    values, count = np.unique(y[out], return_counts=True)
    about = '' if values.size == 1 else 'about '
    sentence = (
        f'{counted(int(out.sum()), "reading")} of {about}'
        f'{1e6 * float(values[np.argmax(count)]):.8g} µm far outside of all others: the sensor '
        'was out of range; they are excluded'
    )
    return [sentence]


def _steps(record: Record) -> list[str]:
    steps = steps_of(record)
    if not steps:
        return []
    where = ', '.join(
        f'{1e6 * each.height:+.4g} µm at {record.start + each.sample * record.dt:.6g} s'
        for each in steps[:3]
    )
    more = '' if len(steps) <= 3 else f' and {len(steps) - 3} more'
    kind = record.info.input_name
    sentence = (
        f'the reading jumps by {where}{more} and stays, but the {kind} does not jump: the counter '
        'of the sensor slipped or was set to zero; `import --without-steps` writes the record '
        'without these steps'
    )
    return [sentence]


def corrected(record: Record) -> Record:
    """Return the record without the steps of its counter."""
    steps = steps_of(record)
    if not steps:
        return record
    return replace(record, displacement=without_steps(record.displacement, steps))
