"""Amplitude spectrum of the last samples, with the harmonics of the drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.reporting.signals import amplitude_spectrum

ORDERS = (1, 2, 3, 4, 5, 7, 9)
LONGEST = 1 << 15
SHORTEST = 32


@dataclass(frozen=True)
class Spectrum:
    """Lines of a spectrum and the harmonics of the drive."""

    frequency: FloatArray  # frequency [Hz], shape (n,)
    amplitude: FloatArray  # amplitude [m] of each line, shape (n,)
    orders: tuple[int, ...] = ()  # harmonic orders below half the sampling rate
    harmonics: FloatArray = field(default_factory=lambda: np.empty(0))  # [m]


def unbroken_end(signal: FloatArray) -> FloatArray:
    """Return the end of `signal` after the last missing sample."""
    missing = np.flatnonzero(np.isnan(signal))
    if missing.size and missing[-1] == signal.size - 1:
        # the reference of the last tick may not have arrived
        return unbroken_end(signal[:-1]) if signal.size > 1 else signal[:0]
    return signal[missing[-1] + 1 :] if missing.size else signal


def live_spectrum(
    signal: FloatArray, dt: float, fundamental: float, orders: tuple[int, ...] = ORDERS
) -> Spectrum | None:  # signal [m] (n,); dt [s]; fundamental [Hz]
    """Return the spectrum of the last whole periods of `signal`, None if it is too short."""
    end = unbroken_end(signal)[-LONGEST:]
    end = end[end.size - whole_periods(end.size, fundamental, dt) :]
    if end.size < SHORTEST:
        return None
    frequency, amplitude = amplitude_spectrum(end, dt)
    inside = tuple(k for k in orders if 0 < k * fundamental < 0.5 / dt)
    return Spectrum(frequency, amplitude, inside, _projected(end, dt, fundamental, inside))


def whole_periods(n: int, frequency: float, dt: float) -> int:
    """Return the number of samples in whole periods among `n`; all if there is no whole period."""
    periods = math.floor(n * frequency * dt + 1e-9)
    return min(n, round(periods / (frequency * dt))) if periods > 0 else n


def _projected(
    signal: FloatArray, dt: float, fundamental: float, orders: tuple[int, ...]
) -> FloatArray:
    """Return the amplitude at each order by projection on its phasor.

    A period need not be a whole number of samples. From two periods on, a Hann window separates
    the orders, because its zeros are at the other orders. A single period has no window.
    """
    turn = fundamental * dt * np.arange(signal.size)
    window = np.ones(signal.size)
    if turn[-1] > 1.5:
        window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(signal.size) / signal.size)
    window /= window.sum()
    centred = window * (signal - np.sum(window * signal))
    return np.array([2 * abs(np.sum(centred * np.exp(-2j * np.pi * k * turn))) for k in orders])
