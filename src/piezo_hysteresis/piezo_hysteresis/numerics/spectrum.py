"""Spectral lines of a signal that are not harmonics of its drive.

A slow drive has a harmonic near every line, also at 50 Hz. High harmonics have similar amplitudes,
so a line far above its neighbours is not caused by the drive.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from piezo_hysteresis.arrays import BoolArray, FloatArray, IntArray
from piezo_hysteresis.numerics.harmonics import HIGHEST_ORDER
from piezo_hysteresis.numerics.linalg import straight_line

# Lines nearer to a harmonic of the drive than so many bins belong to it: two are half the main
# lobe of the window, one more is for a harmonic between two bins.
BINS = 3.0
# Share of the power of a residual from which one line may be a tone, however near a harmonic.
DOMINANT = 0.5
# Lines of the mean and its leakage.
_SLOW = 3
# A line on a harmonic above the highest reported one is separate if it is this factor larger than
# each of the four neighbouring harmonics: ten harmonics that fall by a square law differ by half
# from one to the next.
_ALONE = 5.0


def autocorrelation(signal: FloatArray) -> FloatArray:
    """Return ``sum signal(k) signal(k + lag)`` for the lags 0 to n - 1, shape (n,).

    Of a record of millions of samples it needs four times its memory: the length need not be a
    power of two, and the spectrum is overwritten.
    """
    size = next_fast_len(2 * signal.size - 1, real=True)
    spectrum = rfft(signal, size)
    parts = spectrum.view(np.float64).reshape(-1, 2)
    np.square(parts, out=parts)
    parts[:, 0] += parts[:, 1]
    parts[:, 1] = 0.0
    return np.asarray(irfft(spectrum, size, overwrite_x=True)[: signal.size], dtype=np.float64)


def windowed(signal: FloatArray, *, trend: bool = False) -> FloatArray:  # signal (n,)
    """Return the magnitudes of the lines of a signal in a Hann window."""
    if trend:
        level, slope = straight_line(signal)
        flat = signal - (level + slope * np.arange(signal.size))
    else:
        flat = signal - signal.mean()
    return np.asarray(np.abs(np.fft.rfft(np.hanning(signal.size) * flat)))


def resolved_lines(signal: FloatArray, *, trend: bool = False) -> FloatArray:
    """Return the lines of `windowed`, 0 at the slowest: the mean, a drift and their leakage."""
    lines = windowed(signal, trend=trend)
    lines[:_SLOW] = 0.0
    return lines


def non_harmonic_lines(
    signal: FloatArray, dt: float, drive: float, *, trend: bool = False
) -> tuple[FloatArray, FloatArray]:  # signal (n,); dt [s]; drive [Hz]
    """Return frequencies [Hz] and magnitudes of the lines that are no harmonic of the drive.

    The others are 0, but those of high orders that stand alone.
    """
    lines = resolved_lines(signal, trend=trend)
    frequency = np.asarray(np.fft.rfftfreq(signal.size, dt))
    if drive > 0.0:
        order = frequency / drive
        near = np.abs(order - np.round(order)) * drive < BINS / (signal.size * dt)
        orders, spacing = np.round(order).astype(np.int64), drive * signal.size * dt
        lines[near & ~_alone(lines, near, orders, spacing)] = 0.0
    return frequency, lines


def _alone(lines: FloatArray, near: BoolArray, order: IntArray, spacing: float) -> BoolArray:
    """Return which lines belong to a harmonic far above its neighbours.

    In a record of few periods one line covers several harmonics; its neighbours are the next ones
    outside it, with `spacing` lines between harmonics.
    """
    apart = max(1, ceil(2.0 * BINS / spacing))
    most, reach = int(order[-1]) + 1, apart + 1
    peaks = np.zeros(most + 2 * reach)
    np.maximum.at(peaks, order[near] + reach, lines[near])
    shifts = (-reach, -apart, apart, reach)
    beside = np.max([peaks[reach + k : reach + k + most] for k in shifts], axis=0)
    alone = peaks[reach : reach + most] > _ALONE * beside
    alone[: HIGHEST_ORDER + 1] = False
    return np.asarray(alone[order])
