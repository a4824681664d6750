"""Least-squares fit of the harmonics of a known frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.numerics.linalg import solve_least_squares

HIGHEST_ORDER = 12
_BELOW_NYQUIST = 0.45  # of the sampling rate


def phase_of(frequency: float, dt: float, count: int, first: int = 0) -> FloatArray:
    """Return the phase of a tone [rad] at `count` samples from `first` on, 0 at sample 0.

    Parameters
    ----------
    frequency : float
        Of the tone [Hz].
    dt : float
        Sampling interval [s].
    """
    return np.asarray(2.0 * np.pi * frequency * dt * (first + np.arange(count)), np.float64)


def harmonics(
    signal: FloatArray, frequency: float, dt: float
) -> tuple[list[int], FloatArray, float]:
    """Fit the harmonics of `frequency` to a signal.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Over at least one period.
    frequency : float
        Of the fundamental [Hz].
    dt : float
        Sampling interval [s].

    Returns
    -------
    orders : list of int
        From 0, the mean, to the highest that the sampling rate shows, at most `HIGHEST_ORDER`.
    phasors : ndarray of complex, shape (orders,)
        Of the signal's unit: ``signal = sum Re(phasor exp(j order phi))``; zeros where the signal
        is no number.
    left : float
        Rms of what is on none of them.
    """
    highest = min(HIGHEST_ORDER, int(_BELOW_NYQUIST / (frequency * dt)))
    orders = list(range(highest + 1))
    phase = phase_of(frequency, dt, signal.size)
    mean, phasors, left = lines_and_rest(signal, phase, orders[1:])
    return orders, np.concatenate([[mean], phasors]), float(np.sqrt(np.mean(left**2)))


def line_amplitudes(
    signal: FloatArray, phase: FloatArray, orders: Sequence[int]
) -> tuple[float, ComplexArray]:
    """Return mean and complex amplitudes of a signal, see `lines_and_rest`."""
    return lines_and_rest(signal, phase, orders)[:2]


def lines_and_rest(
    signal: FloatArray, phase: FloatArray, orders: Sequence[int]
) -> tuple[float, ComplexArray, FloatArray]:
    """Fit mean and complex amplitudes of `orders` to `signal` by least squares.

    Parameters
    ----------
    signal, phase : ndarray, shape (n,)
        Signal and accumulated phase of its fundamental [rad].
    orders : sequence of int
        Orders above 0.

    Returns
    -------
    mean : float
    phasors : ndarray of complex, shape (len(orders),)
        E such that the signal is ``mean + sum Re(E exp(j n phi))``.
    left : ndarray, shape (n,)
        What is on none of them.
    """
    columns = [np.ones_like(phase)]
    for order in orders:
        columns += [np.cos(order * phase), np.sin(order * phase)]
    basis = np.column_stack(columns)
    solution = solve_least_squares(basis, signal).values
    return float(solution[0]), solution[1::2] - 1j * solution[2::2], signal - basis @ solution
