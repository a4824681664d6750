"""Lines of a periodic signal: which orders, at which folded frequency, and how large they are."""

from __future__ import annotations

import math
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.jit import jit, leaf, scratch


class Harmonic(NamedTuple):
    """Estimate of one order.

    Attributes
    ----------
    order : int
        Multiple of the fundamental; 0 is the mean.
    error_amplitude : float
        Amplitude of the tracking error y - d at that order [m].
    error_phase : float
        Its phase: the error is ``amplitude cos(order phi + phase)`` [rad].
    correction_amplitude : float
        Amplitude of the correction [V].
    correction_phase : float
        Its phase [rad].
    """

    order: int
    error_amplitude: float
    error_phase: float
    correction_amplitude: float
    correction_phase: float


# Highest order near a resonance, and largest number of orders that it adds.
HIGHEST, MOST = 75, 6
# Highest frequency of an order that is chosen by itself, as a share of the rate, and the smallest
# gain there, as a share of that at 0 Hz.
_SHARE_OF_RATE, _FOLLOWED = 0.25, 0.025
# About so many multiplications of a factorisation are made in one tick, twice those of adding a
# sample to a fit of 64 orders.
_WORK = 16000


@leaf
def folded(frequency: float, dt: float) -> float:
    """Return the signed frequency in -1/(2 dt) .. 1/(2 dt) that sampling makes of `frequency`."""
    rate = 1.0 / dt
    return frequency - rate * round(frequency / rate)


@jit
def fill_resonant(
    frequency: float, natural_frequency: float, dt: float, highest: int, orders: FloatArray
) -> int:
    """Fill the orders that a resonance amplifies, most amplified first; return their number.

    ``round(fn / f)`` and its neighbours, odd ones first, as a symmetric hysteresis generates them.
    Orders with an alias at the resonance are included: 19 x 49 Hz at 1 kHz appears at 69 Hz.
    """
    count, most = 0, orders.size
    if frequency <= 0.0 or natural_frequency <= 0.0:
        return 0
    distances = scratch(most)
    for order in range(2, highest + 1):
        distance = abs(abs(folded(order * frequency, dt)) - natural_frequency)
        distance *= 1.0 if order % 2 else 1.25
        if not distance < 0.3 * natural_frequency:
            continue
        place = count
        while place > 0 and distances[place - 1] > distance:
            place -= 1
        if place >= most:
            continue
        count = min(count + 1, most)
        for k in range(count - 1, place, -1):
            distances[k], orders[k] = distances[k - 1], orders[k - 1]
        distances[place], orders[place] = distance, order
    return count


@jit
def fill_followed(frequency: float, g: FloatArray, dt: float, orders: FloatArray) -> int:
    """Fill the lowest orders that a plant of packed gain `g` follows; return their number.

    Above a quarter of the rate the gain of a held voltage falls to 0, and its inverse would turn
    noise into voltage; the same holds where the plant answers little.
    """
    count, order = 0, 1
    least = _FOLLOWED * abs(gain_at(0.0, g))
    while count < orders.size and order * frequency <= _SHARE_OF_RATE / dt:
        if abs(gain_at(order * frequency, g)) >= least:
            orders[count] = order
            count += 1
        order += 1
        if order > 10 * orders.size:
            break
    return count


@jit
def fill_separable(
    orders: FloatArray, frequency: float, dt: float, span: float, kept: FloatArray
) -> int:
    """Fill those of `orders` that a fit over `span` seconds can separate; return their number.

    Two orders whose sampled images fall closer together than one line of the span, or an order on
    0 or the Nyquist frequency, would make the fit singular.
    """
    resolution, nyquist = 0.6 / span, 0.5 / dt
    count = 0
    lines = scratch(orders.size + 1)
    for i in range(orders.size):
        line = abs(folded(orders[i] * frequency, dt)) if orders[i] > 0.0 else 0.0
        apart = orders[i] == 0.0 or (line <= nyquist - resolution and line >= resolution)
        for k in range(count):
            if kept[k] == orders[i] and orders[i] > 0.0:
                apart = False
            if orders[i] > 0.0 and kept[k] > 0.0 and not abs(line - lines[k]) >= resolution:
                apart = False
        if apart:
            kept[count], lines[count] = orders[i], line
            count += 1
    return count


@leaf
def fill_basis(phase: float, orders: FloatArray, basis: FloatArray) -> None:
    """Write 1, cos(n phase), -sin(n phase) per order into `basis`, shape (1 + 2 orders,)."""
    basis[0] = 1.0
    for i in range(orders.size):
        angle = orders[i] * phase
        basis[1 + 2 * i] = math.cos(angle)
        basis[2 + 2 * i] = -math.sin(angle)


@leaf
def accumulate(
    error: float, phase: float, orders: FloatArray, basis: FloatArray, normal: FloatArray
) -> None:
    """Add one sample to the normal equations of m unknowns.

    `normal` holds the rows of a square of m + 1, one after another; the last one those of the
    error.
    """
    fill_basis(phase, orders, basis)
    m = basis.size
    last = m * (m + 1)
    for i in range(m):
        row, value = i * (m + 1), basis[i]
        for j in range(i + 1):
            normal[row + j] += value * basis[j]
        normal[last + i] += value * error
    normal[last + m] += error * error


@jit
def factor(normal: FloatArray, m: int, count: float, first: int) -> int:
    """Factor the normal equations of `m` unknowns in place (Cholesky), from row `first` on.

    A fit of many orders is spread over ticks, so that none takes much longer than the others.
    """
    size, work, i = m + 1, 0, first
    while i < size and work < _WORK:
        row = i * size
        for j in range(i + 1):
            total, other = normal[row + j], j * size
            for k in range(j):
                total -= normal[row + k] * normal[other + k]
            if j < i:
                normal[row + j] = total / normal[other + j]
            elif i < m:
                # A slight ridge: a window cut short by a frequency step must not fail.
                total += 1e-12 * count
                normal[row + j] = math.sqrt(total) if total > 0.0 else math.nan
            else:
                normal[row + j] = math.sqrt(total) if total > 0.0 else 0.0 * total
        work += i * i
        i += 1
    return i


@jit
def solve_normal(normal: FloatArray, count: float, solution: FloatArray) -> float:
    """Solve normal equations that `factor` has factored."""
    m = solution.size
    size = m + 1
    for i in range(m - 1, -1, -1):
        total = normal[m * size + i]
        for k in range(i + 1, m):
            total -= normal[k * size + i] * solution[k]
        solution[i] = total / normal[i * size + i]
    sound = math.isfinite(normal[m * size + m])
    for i in range(m):
        sound = sound and math.isfinite(solution[i])
    if not sound:
        for i in range(m):
            solution[i] = 0.0
        return math.inf
    residual = normal[m * size + m] ** 2 / max(count - m, 1.0)
    return math.sqrt(residual * 2.0 / max(count, 1.0))
