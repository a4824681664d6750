"""Least-squares fit of the harmonics of a known frequency."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, cos, pi, sin

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from piezo_hysteresis.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_factored, straight_line
from piezo_hysteresis.numerics.qr import BLOCK, extend

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


HIGHEST_ORDER = 12
_BELOW_NYQUIST = 0.45  # largest frequency relative to the sampling rate
# A third or fifth harmonic above this share of the fundamental is an odd harmonic oscillation; the
# hysteresis of a bimorph alone makes 2 to 3 % of third harmonic.
_OSCILLATION = 0.05


def phase_of(frequency: float, dt: float, count: int, first: int = 0) -> FloatArray:
    """Return the phase of a tone [rad] at `count` samples from `first` on, 0 at sample 0."""
    # frequency [Hz]; dt [s]
    return np.asarray(2.0 * np.pi * frequency * dt * (first + np.arange(count)), np.float64)


def harmonics(
    signal: FloatArray, frequency: float, dt: float
) -> tuple[list[int], FloatArray, float]:
    """Fit the harmonics of `frequency` to a signal."""
    # signal (n,); frequency [Hz]; dt [s] -> phasors (orders,)
    orders, phase = orders_below(frequency, dt), phase_of(frequency, dt, signal.size)
    mean, phasors, left = lines_and_rest(signal, phase, orders)
    return [0, *orders], np.concatenate([[mean], phasors]), float(np.sqrt(np.mean(left**2)))


def orders_below(frequency: float, dt: float) -> list[int]:
    """Return the orders of harmonics below half the sampling rate, up to `HIGHEST_ORDER`."""
    return list(range(1, min(HIGHEST_ORDER, int(_BELOW_NYQUIST / (frequency * dt))) + 1))


def line_amplitudes(
    signal: FloatArray, phase: FloatArray, orders: Sequence[int]
) -> tuple[float, ComplexArray]:
    """Return mean and complex amplitudes of a signal, see `lines_and_rest`."""
    return lines_and_rest(signal, phase, orders)[:2]


def lines_and_rest(
    signal: FloatArray, phase: FloatArray, orders: Sequence[int]
) -> tuple[float, ComplexArray, FloatArray]:
    """Fit mean and complex amplitudes of `orders` to `signal` by least squares."""
    # signal, phase [rad] (n,) -> phasors (len(orders), left (n,)
    count, size = 2 + 2 * len(orders), phase.size
    blocks = [slice(begin, min(begin + BLOCK, size)) for begin in range(0, size, BLOCK)]
    factor = np.zeros((count, count))
    for block in blocks:
        extend(factor, np.vstack([_turns(phase[block], orders), signal[block]]))
    solution = solve_factored(factor, np.finfo(float).eps * max(size, count)).values
    left = np.empty(size)
    for block in blocks:
        left[block] = signal[block] - solution @ _turns(phase[block], orders)
    return float(solution[0]), solution[1::2] - 1j * solution[2::2], left


def _turns(phase: FloatArray, orders: Sequence[int]) -> FloatArray:
    """Return ones, and cosine and sine of each order, shape (1 + 2 orders, n)."""
    rows = np.ones((1 + 2 * len(orders), phase.size))
    first, turn = np.exp(1j * phase), np.ones(phase.size, dtype=np.complex128)
    for order in range(1, max(orders, default=0) + 1):
        turn *= first  # a third of the time of a cosine and a sine
        for place in (k for k, each in enumerate(orders) if each == order):
            rows[1 + 2 * place], rows[2 + 2 * place] = turn.real, turn.imag
    return rows


def tone_amplitude(signal: FloatArray, frequency: float, dt: float, first: int = 0) -> complex:
    """Fit a mean and one tone, as `lines_and_rest` does, in one pass."""
    # signal (n,); frequency [Hz]; dt [s]
    step = 2.0 * pi * frequency * dt
    return complex(*_tone(np.ascontiguousarray(signal), step, step * first))


@jit
def _tone(signal: FloatArray, step: float, phase: float) -> tuple[float, float]:
    """Return real and imaginary part of a tone with `step` [rad] per sample."""
    c, s, by_cos, by_sin = cos(phase), sin(phase), cos(step), sin(step)
    x1 = c1 = s1 = xc = xs = cc = cs = ss = 0.0
    for value in signal:
        x1 += value
        c1 += c
        s1 += s
        xc += value * c
        xs += value * s
        cc += c * c
        cs += c * s
        ss += s * s
        c, s = c * by_cos - s * by_sin, s * by_cos + c * by_sin
    n = signal.size
    xc, xs = xc - x1 * c1 / n, xs - x1 * s1 / n
    cc, cs, ss = cc - c1 * c1 / n, cs - c1 * s1 / n, ss - s1 * s1 / n
    size = cc * ss - cs * cs
    if not size > 1e-12 * cc * ss:
        return 0.0, 0.0
    return (xc * ss - xs * cs) / size, -(xs * cc - xc * cs) / size


def without_tone(signal: FloatArray, frequency: float, dt: float) -> float:
    """Return the sum of squares that a fitted mean and tone leave of a signal, in two passes."""
    # signal (n,); frequency [Hz]; dt [s]
    step, signal = 2.0 * pi * frequency * dt, np.ascontiguousarray(signal)
    return float(_less_tone(signal, step, *_tone(signal, step, 0.0)))


@jit
def _less_tone(signal: FloatArray, step: float, real: float, imag: float) -> float:
    """Return the sum of squares about its mean of a signal less a tone."""
    c, s, by_cos, by_sin = 1.0, 0.0, cos(step), sin(step)
    total = squares = 0.0
    for value in signal:
        left = value - real * c + imag * s
        total += left
        squares += left * left
        c, s = c * by_cos - s * by_sin, s * by_cos + c * by_sin
    return squares - total * total / signal.size


def odd_oscillation(signal: FloatArray, frequency: float, dt: float) -> int:
    """Return the odd harmonic of a signal that exceeds that of a hysteresis: 3, 5; 0: none."""
    # signal [s] (n,); frequency [Hz]; dt [s]
    seen = np.isfinite(signal)
    highest = int(0.5 / (frequency * dt))
    orders = [order for order in (1, 2, 3, 5, 7) if order < highest]
    count = np.count_nonzero(seen)
    if 3 not in orders or count * frequency * dt < 1.0 or count < 4 * len(orders):
        return 0
    phase = np.asarray(2.0 * pi * frequency * dt * np.flatnonzero(seen), np.float64)
    _, phasors = line_amplitudes(signal[seen], phase, orders)
    size = dict(zip(orders, np.abs(phasors), strict=True))
    strongest = max((n for n in (3, 5) if n in size), key=lambda n: size[n])
    return strongest if size[strongest] > _OSCILLATION * size[1] else 0
