"""Lines of a signal beside those of its drive."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.linalg import straight_line

# Lines nearer to a harmonic of the drive than so many bins belong to it: two are half the main
# lobe of the window, one more is for a harmonic between two bins.
BINS = 3.0
# The mean and what its window spreads.
_SLOW = 3


def windowed(signal: FloatArray, *, trend: bool = False) -> FloatArray:
    """Return the magnitudes of the lines of a signal in a Hann window.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Of any unit.
    trend : bool
        Whether its straight line is taken out first, and not the mean alone.
    """
    if trend:
        level, slope = straight_line(signal)
        flat = signal - (level + slope * np.arange(signal.size))
    else:
        flat = signal - signal.mean()
    return np.asarray(np.abs(np.fft.rfft(np.hanning(signal.size) * flat)))


def beside_the_drive(
    signal: FloatArray, dt: float, drive: float, *, trend: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and magnitudes of the lines that are no harmonic of the drive.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Of any unit.
    dt : float
        Sampling interval [s].
    drive : float
        Fundamental frequency [Hz]; 0 where there is none.
    trend : bool
        See `windowed`.
    """
    lines = windowed(signal, trend=trend)
    frequency = np.asarray(np.fft.rfftfreq(signal.size, dt))
    lines[:_SLOW] = 0.0
    if drive > 0.0:
        order = frequency / drive
        near = np.abs(order - np.round(order)) * drive
        lines[near < BINS / (signal.size * dt)] = 0.0
    return frequency, lines
