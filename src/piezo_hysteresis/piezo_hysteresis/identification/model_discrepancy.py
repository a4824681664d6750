"""Discrepancy of a model, from the residuals of its free run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite, nan, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.drive_lines import (
    PERIODS,
    amplitudes,
    at_its_largest,
    drive_lines,
    drive_phase,
    drive_turn,
    octaves_of,
    varies,
)
from piezo_hysteresis.identification.noise import density, reach_of
from piezo_hysteresis.identification.periods import main_frequency
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Condition, Discrepancy
from piezo_hysteresis.numerics.harmonics import (
    line_amplitudes,
    lines_and_rest,
    orders_below,
    phase_of,
)
from piezo_hysteresis.records import Record

#: Lines and bands with less than this of the power of a residual are not reported.
LEAST_POWER = 1e-3
# Parts of a record whose harmonics are compared, as long as what is held out, and the mean
# amplitude of the drive, over the largest, from which a part is evaluated.
_PARTS = 4
_MOVES = 0.25
# Periods for which a drive must hold its largest amplitude to have phases.
_HELD_FOR = 2.0


@dataclass(frozen=True)
class RecordResidual:
    """Residual of a free run on one record after its warm-up."""

    name: str  # name of the record
    error: FloatArray  # measured minus simulated [m], shape (n,)
    dt: float  # sampling interval [s]
    frequency: float  # frequency of the drive [Hz]; 0 if it is not periodic
    amplitude: float  # half the range of the input [V or N]
    stroke: float  # range of the measured displacement [m]
    noise: float = nan  # rms of the measurement noise [m]; NaN if unknown
    noise_colour: float = 0.0  # correlation of the noise from one sample to the next
    voltage: FloatArray | None = None  # input [V or N], the reference of the phases, shape (n,)


def residual_of(record: Record, found: Prediction) -> RecordResidual:
    """Return the residual of the prediction of a whole record after its warm-up."""
    view = found.target
    return RecordResidual(
        name=record.name,
        error=found.valid_error,
        dt=record.dt,
        frequency=record.info.frequency or main_frequency(record),
        amplitude=0.5 * float(np.ptp(record.voltage)),
        stroke=reach_of(view.kept(view.measured)),
        noise=view.noise,
        noise_colour=view.noise_colour,
        voltage=view.pick(view.voltage),
    )


def discrepancy_of(residuals: Iterable[RecordResidual], *, held_out: bool) -> Discrepancy | None:
    """Return the discrepancy of a model by frequency, harmonic and amplitude."""
    found = [
        condition_of(each)
        for each in residuals
        if each.stroke > 0.0 and np.all(np.isfinite(each.error))
    ]
    found.sort(key=lambda c: (c.frequency, c.amplitude))
    return Discrepancy(held_out, tuple(found)) if found else None


def condition_of(residual: RecordResidual) -> Condition:
    """Return the discrepancy under the condition of one record."""
    error = residual.error
    rms = float(np.sqrt(np.mean(error**2)))
    periodic = residual.frequency > 0.0 and error.size * residual.dt * residual.frequency >= 1.0
    least = LEAST_POWER * rms**2
    lines, broadband = _split(residual) if periodic else ({}, error)
    sizes = {order: rms for order, rms in lines.items() if rms**2 > least}
    return Condition(
        frequency=residual.frequency if periodic else 0.0,
        amplitude=residual.amplitude,
        stroke=residual.stroke,
        rms=rms,
        noise=residual.noise if isfinite(residual.noise) else None,
        harmonics=sizes,
        bands=_beyond_noise(residual, broadband, least)
        if periodic
        else _octaves(error, residual.dt, least),
        phases=_phases(residual, sizes) if periodic else {},
        scatter=_scatter(residual, sizes) if periodic else {},
        drive={}
        if residual.voltage is None
        else waveform_of(residual.voltage, residual.dt, residual.frequency if periodic else 0.0),
    )


def waveform_of(voltage: FloatArray, dt: float, frequency: float) -> dict[int, float]:
    """Return the waveform of a drive, as `Condition.drive` states it."""
    # voltage [V or N] (n,); dt [s]; frequency [Hz]
    if not np.ptp(voltage) > 0.0:
        return {}
    if frequency > 0.0 and voltage.size * dt * frequency >= 1.0:
        orders = [n for n in (1, 2, 3) if n in orders_below(frequency, dt)]
        phase = drive_phase(voltage, dt, frequency)
        sizes = np.abs(line_amplitudes(voltage, phase, orders)[1])
        return {n: float(each / sizes[0]) for n, each in zip(orders, sizes, strict=True)}
    powers = _powers(voltage)
    octave, _ = octaves_of(voltage.size, dt, 0.0)
    least, whole = int(octave.min(initial=0)), max(float(powers.sum()), 1e-300)
    shares = np.sqrt(np.bincount(octave - least, powers) / whole)
    return {least + k: float(each) for k, each in enumerate(shares) if each > LEAST_POWER}


def _split(residual: RecordResidual) -> tuple[dict[int, float], FloatArray]:
    """Return the rms of each harmonic, 0 being the mean, and the remainder.

    If the drive changes its amplitude, the harmonics follow it: `drive_lines`.
    """
    error, dt, drive = residual.error, residual.dt, residual.frequency
    if residual.voltage is not None and varies(amplitudes(residual.voltage, dt, drive)):
        lines = drive_lines(residual.voltage, dt, drive)
        if lines is not None:
            mean = float(np.mean(error))
            shares, broadband = lines.split(error - mean)
            power = np.bincount(lines.orders, shares**2 / error.size)
            power[0] += mean**2
            return {n: sqrt(float(p)) for n, p in enumerate(power)}, broadband
    orders = orders_below(drive, dt)
    mean, phasors, broadband = lines_and_rest(error, _turn(residual), orders)
    sizes = {n: sqrt(0.5) * float(abs(each)) for n, each in zip(orders, phasors, strict=True)}
    return {0: abs(mean), **sizes}, broadband


def _turn(residual: RecordResidual) -> FloatArray:
    """Return the phase of the drive at each sample [rad]."""
    if residual.voltage is None:
        return phase_of(residual.frequency, residual.dt, residual.error.size)
    return drive_phase(residual.voltage, residual.dt, residual.frequency)


def _phases(residual: RecordResidual, orders: Iterable[int]) -> dict[int, float]:
    """Return the phases of harmonics minus their order times the phase of the drive [rad].

    The phases apply at the largest amplitude; there are none if it is not held long enough.
    """
    above = [order for order in orders if order > 0]
    if residual.voltage is None or not above:
        return {}
    dt, drive = residual.dt, residual.frequency
    where = at_its_largest(residual.voltage, dt, drive)
    if np.count_nonzero(where) * dt * drive < _HELD_FOR:
        return {}
    turn = drive_turn(residual.voltage, dt, drive)
    phasors = line_amplitudes(residual.error[where], turn[where], above)[1]
    return {n: float(np.angle(each)) for n, each in zip(above, phasors, strict=True)}


def _scatter(residual: RecordResidual, orders: Iterable[int]) -> dict[int, float]:
    """Return the rms by which harmonics differ between parts of a record [m].

    A fit minimises their mean over the record, so that single parts may differ more. They are
    assumed proportional to the drive; parts with a small drive are not used.
    """
    above = [order for order in orders if order > 0]
    dt, drive = residual.dt, residual.frequency
    if (
        residual.voltage is None
        or not above
        or residual.error.size * dt * drive < _PARTS * PERIODS
    ):
        return {}
    reach = amplitudes(residual.voltage, dt, drive)
    size = reach / max(float(reach.max()), 1e-300)
    turn = _turn(residual)
    cuts = np.array_split(np.arange(size.size), _PARTS)
    rows = [
        line_amplitudes(residual.error[part], turn[part], above)[1] / float(size[part].mean())
        for part in cuts
        if float(size[part].mean()) > _MOVES
    ]
    if len(rows) < 2:
        return {}
    spread = np.std(np.array(rows), axis=0, ddof=1)
    return dict(zip(above, map(float, sqrt(0.5) * spread), strict=True))


def _beyond_noise(residual: RecordResidual, left: FloatArray, least: float) -> dict[float, float]:
    """Return the rms by octave between the harmonics, in excess of the noise."""
    count, dt = left.size, residual.dt
    known = residual.noise if isfinite(residual.noise) else 0.0
    angle = 2.0 * np.pi * np.fft.rfftfreq(count)[1:]
    noise = 2.0 * known**2 / count * density(residual.noise_colour, np.cos(angle))
    found = _by_octave(_powers(left) - noise, count, dt, residual.frequency)
    return {low: sqrt(square) for low, square in found.items() if square > least}


def _octaves(error: FloatArray, dt: float, least: float) -> dict[float, float]:
    """Return the rms by octave, from the lowest frequency that the record resolves."""
    mean = float(np.mean(error))
    squares = {0.0: mean**2, **_by_octave(_powers(error), error.size, dt, 0.0)}
    return {low: sqrt(square) for low, square in squares.items() if square > least}


def _powers(error: FloatArray) -> FloatArray:
    """Return the mean square of each bin above 0 of a real spectrum."""
    spectrum = np.fft.rfft(error - np.mean(error))[1:]
    return np.asarray(2.0 * np.abs(spectrum) ** 2 / error.size**2, np.float64)


def _by_octave(powers: FloatArray, count: int, dt: float, drive: float) -> dict[float, float]:
    """Return the sum of powers by octave: `octaves_of`."""
    octave, base = octaves_of(count, dt, drive)
    least = int(octave.min(initial=0))
    sums = np.bincount(octave - least, powers)
    return {base * 2.0 ** (least + k): float(each) for k, each in enumerate(sums)}


def discrepancy_text(known: Discrepancy) -> str:
    """Return a sentence on the discrepancy of a model and its records."""
    where = 'records that were not fitted' if known.held_out else 'fitted records'
    return (
        f'misses {1e6 * known.missed:.3g} µm rms beyond the noise, {100 * known.share:.2g} % '
        f'of the stroke, over all {where}'
    )
