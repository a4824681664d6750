"""What the residual of a model that knows what it misses may look like, record by record.

What a model misses repeats itself with the drive. A harmonic of ten thousand samples holds two
numbers, not ten thousand, so evidence is counted by line and by octave: a residual is split into
the harmonics of the drive and octaves of what is beside them, and each part is compared with what
the noise and the discrepancy of the ``model.yaml`` let expect there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.signal.windows import tukey

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.discovery.selection.policy import HELD, SelectionPolicy
from piezo_hysteresis.identification.factor import inner
from piezo_hysteresis.identification.noise import density as spectrum_of_noise
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import Discrepancy
from piezo_hysteresis.numerics.harmonics import HIGHEST_ORDER, phase_of

# Parts of a residual: orders 0 to the highest, then octaves.
_ORDERS = HIGHEST_ORDER + 1


@dataclass(frozen=True)
class Expectation:
    """What one view may show.

    Attributes
    ----------
    lines : ndarray, shape (q, n)
        Orthonormal rows that span the harmonics of the drive, as they grow with its amplitude.
    line_of : ndarray of int, shape (q,)
        Order to which each row belongs; 0 is the mean as it follows the amplitude.
    octave_of : ndarray of int, shape (bins,)
        Part to which each bin of the spectrum of what is beside the lines belongs.
    expected : ndarray, shape (parts,)
        Mean square that is no news, of the orders and then of the octaves [m^2].
    independent : ndarray, shape (parts,)
        Independent numbers in each part.
    window : ndarray, shape (n,)
        Weight of each sample in the spectrum.
    """

    lines: FloatArray
    line_of: IntArray
    octave_of: IntArray
    expected: FloatArray
    independent: FloatArray
    window: FloatArray

    @property
    def total(self) -> float:
        """Mean square over all parts but the mean [m^2]."""
        return float(self.expected[1:].sum())

    def powers(self, error: FloatArray) -> FloatArray:
        """Return the mean square of each part of an error, shape (n,) [m^2]; its mean is left out.

        The zero of a record is its own, so that its mean says nothing.
        """
        if not np.all(np.isfinite(error)):
            return np.full(self.expected.size, np.inf)
        beside = error - error.mean()
        found = np.zeros(self.expected.size)
        if len(self.lines):
            shares, beside = taken_out(beside, self.lines)
            found += np.bincount(self.line_of, shares**2 / error.size, found.size)
        power = np.abs(np.fft.rfft(self.window * beside)) ** 2
        power[0] = 0.0
        power /= float(self.window @ self.window) * power.size
        return np.asarray(found + np.bincount(self.octave_of, power, found.size))

    def cost(self, powers: FloatArray, policy: SelectionPolicy = HELD) -> float:
        """Return minus the log likelihood, up to a constant [nats].

        The size of what is expected is itself known from about as many numbers as there are: tails
        are those of Student's distribution. The whole counts besides. What lies below what is
        expected is no evidence of anything: an effect that takes what the model has always missed
        explains nothing that is new.
        """
        if not np.all(np.isfinite(powers)):
            return float('inf')
        parts = np.maximum(powers / self.expected, 1.0)
        whole = policy.whole * float(np.log1p(max(powers[1:].sum() / self.total, 1.0)))
        return float(self.independent @ np.log1p(parts)) + whole

    def news(self, powers: FloatArray, policy: SelectionPolicy = HELD) -> bool:
        """Tell whether parts show more than the model is known to miss."""
        if not powers[1:].sum() <= policy.news**2 * self.total:
            return True
        chance = 1.0 + 3.0 / np.sqrt(np.maximum(self.independent, 1.0))
        large = powers > chance * policy.news**2 * self.expected
        return bool(np.any(large & (powers - self.expected > policy.part * self.total)))

    def excess(self, powers: FloatArray) -> float:
        """Return the mean square beyond what is expected, in units of all that is [1]."""
        return float(np.maximum(powers - self.expected, 0.0).sum() / self.total)


def expectation(
    view: Target, known: Discrepancy, stroke: float, policy: SelectionPolicy = HELD
) -> Expectation:
    """Return what a model that is known to miss `known` may leave of a view.

    Parameters
    ----------
    view : Target
        With the noise of its record; where that is not known, the noise under the known
        conditions counts.
    known : Discrepancy
        Of the model.
    stroke : float
        Range of the displacement of the record [m].
    policy : SelectionPolicy
        What decides.
    """
    count, dt = view.measured.size, view.dt * view.stride
    voltage = view.pick(view.voltage)
    amplitude = 0.5 * float(np.ptp(view.voltage[view.origin :]))
    noise = view.noise if isfinite(view.noise) else known.noise
    missed = known.near(view.frequency, amplitude)
    lines, line_of = _lines(voltage, dt, view.frequency, policy)
    frequency = np.asarray(np.fft.rfftfreq(count, dt), dtype=np.float64)
    octave_of = np.full(frequency.size, _ORDERS, dtype=np.int64)
    octave_of[1:] += np.floor(np.log2(np.arange(1, frequency.size))).astype(np.int64)
    parts = int(octave_of.max()) + 1
    density = missed.density(frequency) * (frequency[1] * stroke**2)
    angle = 2.0 * np.pi * dt
    density += noise**2 / frequency.size * spectrum_of_noise(view.noise_colour, angle * frequency)
    expected: FloatArray = np.bincount(octave_of, density, parts).astype(np.float64)
    ranks = np.bincount(line_of, minlength=parts)
    orders = view.frequency * np.arange(_ORDERS, dtype=np.float64)
    at_lines = noise**2 / count * spectrum_of_noise(view.noise_colour, angle * orders)
    expected[:_ORDERS] += ranks[:_ORDERS] * at_lines
    known_lines = {n: (share * stroke) ** 2 for n, share in missed.harmonics.items()}
    for order, square in known_lines.items():
        if ranks[order]:
            expected[order] += square
        elif order:  # too few periods for a line
            near = _octaves_near(order * view.frequency * count * dt, parts - _ORDERS)
            expected[_ORDERS:] += square * near
    independent = np.minimum(2 * np.bincount(octave_of, minlength=parts), policy.octave)
    independent[:_ORDERS] = np.minimum(ranks[:_ORDERS], policy.line)
    total = (missed.share * stroke) ** 2
    expected = np.where(independent > 0, expected + policy.shape * total, 0.0)
    # how the mean follows the amplitude no file of steady drives tells
    expected[0] += total
    expected += 1e-14 * stroke**2 + 1e-300
    window = np.asarray(tukey(count, policy.taper), dtype=np.float64)
    return Expectation(lines, line_of, octave_of, expected, independent.astype(np.float64), window)


def _octaves_near(bin_of_line: float, octaves: int) -> FloatArray:
    """Return in which octaves of a short record a line may lie, shape (octaves,).

    It leaks into the neighbours; a drive that does not repeat (bin 0) leaves it anywhere.
    """
    if bin_of_line <= 0.0:
        return np.full(octaves, 1.0 / octaves)
    place = min(max(int(np.floor(np.log2(max(bin_of_line, 1.0)))), 0), octaves - 1)
    near = np.abs(np.arange(octaves) - place)
    return np.where(near == 0, 1.0, np.where(near == 1, 0.5, 0.0))


def _lines(
    voltage: FloatArray, dt: float, drive: float, policy: SelectionPolicy
) -> tuple[FloatArray, IntArray]:
    """Return orthonormal rows that span the harmonics of a drive [Hz], and the order of each."""
    count = voltage.size
    none = np.zeros((0, count)), np.zeros(0, dtype=np.int64)
    if drive <= 0.0 or drive * dt * count < policy.periods:
        return none
    size = _envelope(voltage, max(round(1.0 / (drive * dt)), 2))
    laws = [np.ones(count)]
    if float(np.std(size)) > policy.steady * float(np.mean(size)):
        laws += [size, size**2]
    angle = phase_of(drive, dt, count)
    rows, orders = list(laws), [0] * len(laws)
    for order in range(1, min(HIGHEST_ORDER, int(0.45 / (drive * dt))) + 1):
        for law in laws:
            rows += [law * np.cos(order * angle), law * np.sin(order * angle)]
            orders += [order, order]
    basis = orthonormal(np.array(rows))
    # the first is the mean, which is left out
    return basis[1:], np.array(orders[1:], dtype=np.int64)


@jit
def orthonormal(rows: FloatArray) -> FloatArray:
    """Return orthonormal rows, shape (q, n), without BLAS threads; zeros for dependent ones."""
    found = rows.copy()
    for j in range(found.shape[0]):
        before = sqrt(inner(found[j], found[j]))
        for _ in range(2):
            for i in range(j):
                found[j] -= inner(found[i], found[j]) * found[i]
        size = sqrt(inner(found[j], found[j]))
        found[j] *= 1.0 / size if size > 1e-6 * before else 0.0
    return found


@jit
def taken_out(error: FloatArray, lines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the shares of orthonormal rows in an error, shape (q,), and what is left."""
    left, shares = error.copy(), np.empty(lines.shape[0])
    for j in range(lines.shape[0]):
        shares[j] = inner(lines[j], left)
        left -= shares[j] * lines[j]
    return shares, left


def _envelope(voltage: FloatArray, period: int) -> FloatArray:
    """Return half the range of a signal over each period, smoothed, over its largest."""
    reach = maximum_filter1d(voltage, period) - minimum_filter1d(voltage, period)
    smooth = uniform_filter1d(reach, period)
    return np.asarray(smooth / max(float(smooth.max()), 1e-300))


def costs(
    errors: Sequence[FloatArray], expected: Sequence[Expectation]
) -> tuple[float, float, bool]:
    """Return cost [nats], excess [1] and whether there is news, over several views."""
    pairs = [(e, e.powers(error)) for e, error in zip(expected, errors, strict=True)]
    return (
        sum(e.cost(p) for e, p in pairs),
        sum(e.excess(p) for e, p in pairs),
        any(e.news(p) for e, p in pairs),
    )
