"""Discrepancy of a model, from the residuals of its free run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.identification.noise import density, reach_of
from piezo_hysteresis.identification.periods import main_frequency
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Condition, Discrepancy
from piezo_hysteresis.numerics.harmonics import (
    ModulatedLines,
    line_amplitudes,
    lines_and_rest,
    orders_below,
    phase_of,
)
from piezo_hysteresis.records import Record

#: Length of a record [periods] from which harmonics are resolved: lines are three bins apart.
PERIODS = 3.0
#: Scatter of the amplitude, over its mean, from which harmonics follow it: below it the
#: dependence on the amplitude is undetermined.
STEADY = 0.05
#: Wander of the phase of the drive [rad] from which harmonics follow it: twelve times as far, the
#: highest harmonic still holds nine tenths of its power in a line of a constant frequency.
WANDERS = 0.025
# Share of the power of a drive in its fundamental from which its phase is that of the drive, and
# amplitude of the fundamental, over the largest, from which its phase is read.
_LEADS = 0.8
_SEEN = 0.25
_STEPS = 32  # phases read in a period, at most
_DEPENDENT = 1e-6  # remaining share of an orthogonalised row below which it is linearly dependent


def drive_lines(
    voltage: FloatArray, dt: float, drive: float, periods: float = PERIODS, steady: float = STEADY
) -> ModulatedLines | None:  # voltage [V] (n,); dt [s]; drive [Hz]
    """Return the lines at the harmonics of a drive, which follow its amplitude.

    Order 0 is the part of the mean that follows the amplitude.
    """
    count = voltage.size
    if drive <= 0.0 or drive * dt * count < periods:
        return None
    size = amplitudes(voltage, dt, drive)
    laws = np.ones((3 if varies(size, steady) else 1, count))
    if len(laws) > 1:
        np.divide(size, max(float(size.max()), 1e-300), out=laws[1])
        np.square(laws[1], out=laws[2])
    del size
    highest = max(orders_below(drive, dt), default=0)
    return ModulatedLines(laws, drive_phase(voltage, dt, drive), highest, _DEPENDENT)


def drive_phase(voltage: FloatArray, dt: float, drive: float) -> FloatArray:
    """Return the phase of the fundamental [rad] at each sample, shape (n,).

    It turns at the frequency `drive`, 0 at the first sample, unless the phase of the drive
    wanders by more than `WANDERS`: then it is that phase, from the fundamental over two periods.
    """
    even = phase_of(drive, dt, voltage.size)
    period = max(round(1.0 / (drive * dt)), 2)
    step = max(period // _STEPS, 1)
    whole = voltage.size // step * step
    if voltage.size < PERIODS * period:
        return even
    mean = float(np.mean(voltage))

    from scipy.ndimage import uniform_filter1d  # `info` imports this module and filters nothing

    def slow(turn: FloatArray) -> FloatArray:
        blocks = ((voltage[:whole] - mean) * turn).reshape(-1, step).mean(axis=1)
        width = round(period / step)
        return np.asarray(uniform_filter1d(uniform_filter1d(blocks, width), width), np.float64)

    real, imaginary = slow(np.cos(even[:whole])), slow(-np.sin(even[:whole]))
    size = np.hypot(real, imaginary)
    ends = -(-period // step)
    inside = np.arange(ends, size.size - ends)
    inside = inside[size[inside] > _SEEN * float(size[inside].max(initial=0.0))]
    leads = 2.0 * float(np.mean(size[inside] ** 2)) if inside.size * step >= period else 0.0
    if leads <= _LEADS * float(np.var(voltage)):
        return even
    place = step * (inside + 0.5) - 0.5
    wander = np.unwrap(np.arctan2(imaginary[inside], real[inside]))
    if float(np.std(wander)) <= WANDERS:
        return even
    slope, level = np.polyfit(place, wander, 1)  # a frequency that is not quite that of the drive
    every = np.arange(voltage.size, dtype=np.float64)
    even += slope * every + level
    even += np.interp(every, place, wander - slope * place - level)
    return even


def octaves_of(count: int, dt: float, drive: float) -> tuple[IntArray, float]:
    """Return the octave of each bin above 0 of a real spectrum, and the first frequency of 0 [Hz].

    Octaves are those of the drive, from sqrt(2) times its frequency up and down, or of 1 Hz where
    it has none: what lies between two harmonics is in the same octave in records of any length.
    What a record resolves of its lowest octave belongs to the one above it.
    """
    # dt [s]; drive [Hz]
    base = sqrt(2.0) * drive if drive > 0.0 else 1.0
    ratio = np.arange(1, count // 2 + 1) / (count * dt * base)
    found = np.floor(np.log2(ratio * (1.0 + 1e-9))).astype(np.int64)
    if found.size and ratio[0] > 2.0 ** found[0] * (1.0 + 1e-9):
        found = np.maximum(found, found[0] + 1)
    return found, base


def amplitudes(voltage: FloatArray, dt: float, drive: float) -> FloatArray:
    """Return half the range of a drive over each period, smoothed, shape (n,) [V]."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    period = max(round(1.0 / (drive * dt)), 2)
    reach = maximum_filter1d(voltage, period)
    reach -= minimum_filter1d(voltage, period)
    smooth = uniform_filter1d(reach, period)
    smooth *= 0.5
    return np.asarray(smooth, dtype=np.float64)


def varies(reach: FloatArray, steady: float = STEADY) -> bool:
    """Return whether harmonics follow an amplitude [V], since it scatters; see `STEADY`."""
    return float(np.std(reach)) > steady * float(np.mean(reach))


def at_its_largest(voltage: FloatArray, dt: float, drive: float) -> NDArray[np.bool_]:
    """Return a mask of the samples within `STEADY` of the largest amplitude, shape (n,)."""
    reach = amplitudes(voltage, dt, drive)
    return np.asarray(reach >= (1.0 - STEADY) * float(reach.max()))


def drive_turn(voltage: FloatArray, dt: float, drive: float) -> FloatArray:
    """Return the phase of a drive [rad], shape (n,): 0 where its fundamental is largest."""
    where = at_its_largest(voltage, dt, drive)
    phase = drive_phase(voltage, dt, drive)
    return phase + float(np.angle(lines_and_rest(voltage[where], phase[where], [1])[1][0]))


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
    noise: float  # rms of the measurement noise [m]; NaN if unknown
    noise_colour: float  # correlation of the noise from one sample to the next
    voltage: FloatArray  # input [V or N], the reference of the phases, shape (n,)


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
    squares = _beyond_noise(residual, broadband) if periodic else _octaves(error, residual.dt)
    return Condition(
        frequency=residual.frequency if periodic else 0.0,
        amplitude=residual.amplitude,
        stroke=residual.stroke,
        rms=rms,
        noise=residual.noise if isfinite(residual.noise) else None,
        harmonics=sizes,
        bands={low: sqrt(square) for low, square in squares.items() if square > least},
        phases=_phases(residual, sizes) if periodic else {},
        scatter=_scatter(residual, sizes) if periodic else {},
        drive=waveform_of(residual.voltage, residual.dt, residual.frequency if periodic else 0.0),
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
    if varies(amplitudes(residual.voltage, dt, drive)):
        lines = drive_lines(residual.voltage, dt, drive)
        if lines is not None:
            mean = float(np.mean(error))
            shares, broadband = lines.split(error - mean)
            power = np.bincount(lines.orders, shares**2 / error.size)
            power[0] += mean**2
            return {n: sqrt(float(p)) for n, p in enumerate(power)}, broadband
    orders = orders_below(drive, dt)
    mean, phasors, broadband = lines_and_rest(
        error, drive_phase(residual.voltage, dt, drive), orders
    )
    sizes = {n: sqrt(0.5) * float(abs(each)) for n, each in zip(orders, phasors, strict=True)}
    return {0: abs(mean), **sizes}, broadband


def _phases(residual: RecordResidual, orders: Iterable[int]) -> dict[int, float]:
    """Return the phases of harmonics minus their order times the phase of the drive [rad].

    The phases apply at the largest amplitude; there are none if it is not held long enough.
    """
    above = [order for order in orders if order > 0]
    if not above:
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
    if not above or residual.error.size * dt * drive < _PARTS * PERIODS:
        return {}
    reach = amplitudes(residual.voltage, dt, drive)
    size = reach / max(float(reach.max()), 1e-300)
    turn = drive_phase(residual.voltage, dt, drive)
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


def _beyond_noise(residual: RecordResidual, left: FloatArray) -> dict[float, float]:
    """Return the mean square by octave between the harmonics, in excess of the noise."""
    count, dt = left.size, residual.dt
    known = residual.noise if isfinite(residual.noise) else 0.0
    angle = 2.0 * np.pi * np.fft.rfftfreq(count)[1:]
    noise = 2.0 * known**2 / count * density(residual.noise_colour, np.cos(angle))
    return _by_octave(_powers(left) - noise, count, dt, residual.frequency)


def _octaves(error: FloatArray, dt: float) -> dict[float, float]:
    """Return the mean square by octave, from the lowest frequency that the record resolves."""
    mean = float(np.mean(error))
    return {0.0: mean**2, **_by_octave(_powers(error), error.size, dt, 0.0)}


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
