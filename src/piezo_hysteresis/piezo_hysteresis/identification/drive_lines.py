"""Harmonics of a drive with varying amplitude and period: the basis of residuals.

If the amplitude of the drive grows, each harmonic and the mean displacement grow with it. If its
period wanders, as on a rig that reverses at a position, harmonic n turns n times as far. The
discrepancy in a model file and the residuals on new records are comparable only in the same basis.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.numerics.harmonics import lines_and_rest, orders_below, phase_of
from piezo_hysteresis.numerics.modulated import ModulatedLines

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
