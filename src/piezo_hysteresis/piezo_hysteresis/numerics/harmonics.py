"""Least-squares fit of the harmonics of a known frequency."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.linalg import solve_least_squares

HIGHEST_ORDER = 12
_BELOW_NYQUIST = 0.45  # of the sampling rate


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
    phase = 2.0 * np.pi * frequency * dt * np.arange(signal.size)
    columns = [np.ones_like(phase)]
    for order in orders[1:]:
        columns += [np.cos(order * phase), np.sin(order * phase)]
    basis = np.column_stack(columns)
    solution = solve_least_squares(basis, signal).values
    left = signal - basis @ solution
    phasors = np.concatenate([[solution[0]], solution[1::2] - 1j * solution[2::2]])
    return orders, phasors, float(np.sqrt(np.mean(left**2)))
