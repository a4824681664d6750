"""Least-squares fit of harmonics, of constant or modulated size."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, cos, pi, sin

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from piezo_hysteresis.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from piezo_hysteresis.jit import inline_jit, jit
from piezo_hysteresis.numerics.linalg import solve_factored, solve_square, straight_line
from piezo_hysteresis.numerics.qr import BLOCK, extend, inner, orthonormalise

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


# Samples of a block, whose turns and products of laws fit into the cache.
_PIECE = 512


class ModulatedLines:
    """Orthonormal lines ``law cos(order phase)`` and ``law sin(order phase)`` with their mean."""

    def __init__(
        self, laws: FloatArray, phase: FloatArray, highest: int, dependent: float
    ) -> None:  # laws (a, n); phase [rad] (n,)
        orthonormalise(laws, dependent)
        self._laws, self._phase, self._highest = laws, phase, highest
        count = len(laws)
        order = [0] * count + [n for n in range(1, highest + 1) for _ in range(2 * count)]
        self.orders: IntArray = np.array(order[1:], dtype=np.int64)
        self._factor, self._kept = _cholesky(self._gram(), dependent**2)

    def _places(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return law, order and kind (0 for a cosine, 1 for a sine) of every line."""
        count = len(self._laws)
        law = [
            *range(count),
            *(a for _ in range(self._highest) for a in range(count) for _ in 'cs'),
        ]
        kind = [0] * count + [0, 1] * (count * self._highest)
        return np.array(law), np.concatenate([[0], self.orders]), np.array(kind)

    def _gram(self) -> FloatArray:
        """Return the inner products of all lines, from sums of at most twice the highest order."""
        law, order, kind = self._places()
        even, odd = _product_sums(self._laws, self._phase, 2 * self._highest)
        less, more = order[:, None] - order, order[:, None] + order
        pair = law[:, None], law
        c_less, c_more = even[(*pair, np.abs(less))], even[(*pair, more)]
        s_less, s_more = np.sign(less) * odd[(*pair, np.abs(less))], odd[(*pair, more)]
        first, second = kind[:, None], kind
        found = np.where(second, s_more - s_less, c_less + c_more)
        found = np.where(first, np.where(second, c_less - c_more, s_more + s_less), found)
        return np.asarray(0.5 * found, dtype=np.float64)

    def split(self, signal: FloatArray) -> tuple[FloatArray, FloatArray]:  # signal (n,)
        """Return the coefficients of orthonormal lines, shape (q,), and the rest of a signal."""
        law, order, kind = self._places()
        even, odd = _signal_sums(self._laws, signal, self._phase, self._highest)
        right = np.where(kind, odd[law, order], even[law, order])
        shares, kept = np.zeros(right.size), self._kept
        lower = self._factor[np.ix_(kept, kept)]
        shares[kept] = solve_square(lower, right[kept]).values
        weights = np.zeros(right.size)
        weights[kept] = solve_square(lower.T, shares[kept]).values
        by_cos, by_sin = np.zeros_like(even), np.zeros_like(odd)
        np.add.at(by_cos, (law[kind == 0], order[kind == 0]), weights[kind == 0])
        np.add.at(by_sin, (law[kind == 1], order[kind == 1]), weights[kind == 1])
        return shares[1:], _less_lines(signal, self._laws, self._phase, by_cos, by_sin)


def _cholesky(gram: FloatArray, least: float) -> tuple[FloatArray, BoolArray]:
    """Return the lower factor of inner products, and the rows that do not depend on others.

    A row depends on those before it if at most the share `least` of its square remains.
    """
    count = len(gram)
    lower, kept = np.zeros((count, count)), np.zeros(count, dtype=bool)
    for j in range(count):
        for i in np.flatnonzero(kept[:j]):
            lower[j, i] = (gram[j, i] - lower[j, :i] @ lower[i, :i]) / lower[i, i]
        left = float(gram[j, j] - lower[j, :j] @ lower[j, :j])
        if left > least * gram[j, j]:
            kept[j], lower[j, j] = True, np.sqrt(left)
    return lower, kept


@inline_jit
def _turn(phase: FloatArray, first: int, by: FloatArray, turn: FloatArray) -> None:
    """Set the first turn of a block of samples, and the zeroth, as rows of cosine and sine."""
    for k in range(by.shape[1]):
        by[0, k], by[1, k] = cos(phase[first + k]), sin(phase[first + k])
        turn[0, k], turn[1, k] = 1.0, 0.0


@inline_jit
def _next(turn: FloatArray, by: FloatArray) -> None:
    """Multiply the turns of a block by the first one."""
    for k in range(by.shape[1]):
        real = turn[0, k] * by[0, k] - turn[1, k] * by[1, k]
        turn[1, k] = turn[0, k] * by[1, k] + turn[1, k] * by[0, k]
        turn[0, k] = real


@jit
def _product_sums(
    laws: FloatArray, phase: FloatArray, highest: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of two laws with cosines and with sines, shapes (a, a, highest + 1)."""
    count, n = laws.shape
    even = np.zeros((count, count, highest + 1))
    odd = np.zeros((count, count, highest + 1))
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn, both = np.empty((2, size)), np.empty((2, size)), np.empty(size)
        products = np.empty((count, count, size))
        for i in range(count):
            for j in range(i + 1):
                products[i, j] = laws[i, begin : begin + size] * laws[j, begin : begin + size]
        _turn(phase, begin, by, turn)
        for m in range(highest + 1):
            for i in range(count):
                for j in range(i + 1):
                    both = products[i, j]
                    even[i, j, m] += inner(both, turn[0])
                    odd[i, j, m] += inner(both, turn[1])
            _next(turn, by)
    for i in range(count):
        for j in range(i):
            even[j, i], odd[j, i] = even[i, j], odd[i, j]
    return even, odd


@jit
def _signal_sums(
    laws: FloatArray, signal: FloatArray, phase: FloatArray, highest: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of a signal with each law and turn, shapes (a, highest + 1)."""
    count, n = laws.shape
    even, odd = np.zeros((count, highest + 1)), np.zeros((count, highest + 1))
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn = np.empty((2, size)), np.empty((2, size))
        weighed = laws[:, begin : begin + size] * signal[begin : begin + size]
        _turn(phase, begin, by, turn)
        for m in range(highest + 1):
            for i in range(count):
                even[i, m] += inner(weighed[i], turn[0])
                odd[i, m] += inner(weighed[i], turn[1])
            _next(turn, by)
    return even, odd


@jit
def _less_lines(
    signal: FloatArray, laws: FloatArray, phase: FloatArray, by_cos: FloatArray, by_sin: FloatArray
) -> FloatArray:
    """Return a signal without lines, for the weights of their cosines and sines."""
    count, n = laws.shape
    left = signal.copy()
    for begin in range(0, n, _PIECE):
        size = min(_PIECE, n - begin)
        by, turn = np.empty((2, size)), np.empty((2, size))
        _turn(phase, begin, by, turn)
        lines = np.zeros((count, size))
        for m in range(by_cos.shape[1]):
            for i in range(count):
                c, s, line = by_cos[i, m], by_sin[i, m], lines[i]
                for k in range(size):
                    line[k] += c * turn[0, k] + s * turn[1, k]
            _next(turn, by)
        for i in range(count):
            for k in range(size):
                left[begin + k] -= laws[i, begin + k] * lines[i, k]
    return left
