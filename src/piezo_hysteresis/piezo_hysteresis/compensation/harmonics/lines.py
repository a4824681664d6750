"""Lines of a periodic signal: which orders, at which folded frequency, and how large they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_least_squares, solve_square


class Harmonic(NamedTuple):
    """What is known of one order.

    Attributes
    ----------
    order : int
        Multiple of the fundamental; 0 is the mean.
    error_amplitude : float
        Amplitude of the tracking error y - d at that order [m].
    error_phase : float
        Its phase: the error is ``amplitude cos(order phi + phase)`` [rad].
    correction_amplitude : float
        Amplitude of what is subtracted from the voltage [V].
    correction_phase : float
        Its phase [rad].
    """

    order: int
    error_amplitude: float
    error_phase: float
    correction_amplitude: float
    correction_phase: float


def folded(frequency: float, dt: float) -> float:
    """Return the signed frequency in -1/(2 dt) .. 1/(2 dt) that sampling makes of `frequency`."""
    rate = 1.0 / dt
    return frequency - rate * round(frequency / rate)


def resonant_orders(
    frequency: float, natural_frequency: float, dt: float, highest: int = 75, most: int = 6
) -> tuple[int, ...]:
    """Return the orders of `frequency` that a resonance amplifies, most amplified first.

    ``round(fn / f)`` and its neighbours, odd ones first, which is what a symmetric hysteresis
    makes. Orders whose sampled image folds back onto the resonance count too: 19 x 49 Hz at 1 kHz
    is heard at 69 Hz.

    Parameters
    ----------
    frequency : float
        Fundamental [Hz].
    natural_frequency : float
        Of the mode [Hz].
    dt : float
        Sampling interval [s].
    highest : int
        Highest order considered.
    most : int
        Largest number of orders returned.
    """
    if frequency <= 0 or natural_frequency <= 0:
        return ()
    found = {}
    for order in range(2, highest + 1):
        distance = abs(abs(folded(order * frequency, dt)) - natural_frequency)
        distance *= 1.0 if order % 2 else 1.25
        if distance < 0.3 * natural_frequency:
            found[order] = distance
    return tuple(sorted(found, key=lambda order: (found[order], order))[:most])


def separable_orders(
    orders: Sequence[int], frequency: float, dt: float, span: float
) -> tuple[int, ...]:
    """Return those of `orders` that a fit over `span` seconds can tell apart, first ones first.

    Two orders whose sampled images fall closer together than one line of the span, or an order on
    0 or the Nyquist frequency, would make the fit singular.
    """
    resolution = 0.6 / span
    nyquist = 0.5 / dt
    kept: list[int] = []
    lines = [0.0]
    for order in orders:
        if order == 0:
            kept.append(0)
            continue
        line = abs(folded(order * frequency, dt))
        if line > nyquist - resolution or order in kept:
            continue
        if min(abs(line - other) for other in lines) >= resolution:
            kept.append(order)
            lines.append(line)
    return tuple(kept)


@jit
def fill_basis(phase: float, orders: FloatArray, basis: FloatArray) -> None:
    """Write 1, cos(n phase), -sin(n phase) per order into `basis`, shape (1 + 2 orders,)."""
    basis[0] = 1.0
    for i in range(orders.size):
        angle = orders[i] * phase
        basis[1 + 2 * i] = np.cos(angle)
        basis[2 + 2 * i] = -np.sin(angle)


@jit
def accumulate(
    error: float, phase: float, orders: FloatArray, basis: FloatArray, normal: FloatArray
) -> None:
    """Add one sample to the normal equations; the last row and column of `normal` hold y."""
    fill_basis(phase, orders, basis)
    m = basis.size
    for i in range(m):
        for j in range(i + 1):
            normal[i, j] += basis[i] * basis[j]
        normal[m, i] += basis[i] * error
    normal[m, m] += error * error


def solve_lines(normal: FloatArray, count: int) -> tuple[float, ComplexArray, float]:
    """Solve accumulated normal equations.

    Returns
    -------
    mean : float
        The constant [unit of the signal].
    phasors : ndarray of complex, shape (orders,)
        E such that the signal is ``mean + sum Re(E exp(j n phi))``.
    deviation : float
        Standard deviation of each real part, from the residual of the fit; infinite where there
        is none.
    """
    m = normal.shape[0] - 1
    matrix = np.tril(normal[:m, :m])
    matrix = matrix + np.tril(matrix, -1).T
    right = normal[m, :m]
    # A slight ridge: a window cut short by a frequency step must not throw.
    solved = solve_square(matrix + 1e-12 * count * np.eye(m), right)
    solution = solved.values
    if not solved.sound:
        return 0.0, solution[1::2] + 1j * solution[2::2], math.inf
    residual = max(normal[m, m] - float(right @ solution), 0.0) / max(count - m, 1)
    phasors = solution[1::2] + 1j * solution[2::2]
    return float(solution[0]), phasors, math.sqrt(residual * 2.0 / max(count, 1))


def line_amplitudes(
    signal: FloatArray, phase: FloatArray, orders: Sequence[int]
) -> tuple[float, ComplexArray]:
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
    """
    columns = [np.ones_like(phase)]
    for order in orders:
        columns += [np.cos(order * phase), -np.sin(order * phase)]
    solution = solve_least_squares(np.column_stack(columns), signal).values
    return float(solution[0]), solution[1::2] + 1j * solution[2::2]
