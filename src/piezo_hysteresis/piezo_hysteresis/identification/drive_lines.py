"""Harmonics of a drive with varying amplitude: the basis in which residuals are decomposed.

If the amplitude of the drive grows, each harmonic and the mean displacement grow with it. The
discrepancy in a model file and the residuals on new records are comparable only in the same basis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.harmonics import lines_and_rest, orders_below, phase_of
from piezo_hysteresis.numerics.modulated import ModulatedLines

#: Length of a record [periods] from which harmonics are resolved: lines are three bins apart.
PERIODS = 3.0
#: Scatter of the amplitude, over its mean, from which harmonics follow it: below it the
#: dependence on the amplitude is undetermined.
STEADY = 0.05
_DEPENDENT = 1e-6  # remaining share of an orthogonalised row below which it is linearly dependent


def drive_lines(
    voltage: FloatArray, dt: float, drive: float, periods: float = PERIODS, steady: float = STEADY
) -> ModulatedLines | None:
    """Return the lines at the harmonics of a drive, which follow its amplitude.

    Order 0 is the part of the mean that follows the amplitude.

    Parameters
    ----------
    voltage : ndarray, shape (n,)
        Voltage of the compared samples [V].
    dt, drive : float
        Sampling interval [s]; frequency of the drive [Hz].
    periods, steady : float
        See `PERIODS` and `STEADY`.

    Returns
    -------
    ModulatedLines or None
        None where there are too few periods.
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
    return ModulatedLines(laws, 2.0 * np.pi * drive * dt, highest, _DEPENDENT)


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


def phase_at(voltage: FloatArray, dt: float, drive: float) -> float:
    """Return the phase of the fundamental of a drive at its first sample [rad]."""
    where = at_its_largest(voltage, dt, drive)
    phase = phase_of(drive, dt, voltage.size)
    return float(np.angle(lines_and_rest(voltage[where], phase[where], [1])[1][0]))
