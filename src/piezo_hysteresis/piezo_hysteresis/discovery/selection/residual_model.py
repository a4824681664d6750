"""What the residual of a model that knows what it misses may look like, record by record.

What a model misses repeats itself with the drive. A harmonic of ten thousand samples holds two
numbers, not ten thousand, so evidence is counted by line and by octave: a residual is split into
the harmonics of the drive and octaves of what is beside them, and each part is compared with what
the noise and the discrepancy of the ``model.yaml`` let expect there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.discovery.selection.policy import HELD, SelectionPolicy
from piezo_hysteresis.identification.discrepancy import LEAST_POWER
from piezo_hysteresis.identification.drive_lines import (
    amplitudes,
    drive_lines,
    phase_at,
)
from piezo_hysteresis.identification.noise import density as spectrum_of_noise
from piezo_hysteresis.identification.qr import projected_out
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Discrepancy
from piezo_hysteresis.models.trace import stretches_of
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
    repeated : ndarray, shape (n,)
        What the model is known to miss under this drive [m]: an error less this is compared with
        `expected`.
    octaves : float
        How far the drive is from the nearest one under which the model was judged.
    """

    lines: FloatArray
    line_of: IntArray
    octave_of: IntArray
    expected: FloatArray
    independent: FloatArray
    window: FloatArray
    repeated: FloatArray
    octaves: float

    @property
    def total(self) -> float:
        """Mean square over all parts but the mean [m^2]."""
        return float(self.expected[1:].sum())

    def out_of_phase(self) -> Expectation:
        """Return what is expected where the phases of what repeats itself are lost."""
        return replace(self, expected=self.expected + self.powers(self.repeated))

    def powers(self, error: FloatArray) -> FloatArray:
        """Return the mean square of each part of an error, shape (n,) [m^2]; its mean is left out.

        The zero of a record is its own, so that its mean says nothing.
        """
        if not np.all(np.isfinite(error)):
            return np.full(self.expected.size, np.inf)
        beside = error - error.mean()
        found = np.zeros(self.expected.size)
        if len(self.lines):
            shares, beside = projected_out(beside, self.lines)
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
        # where a large part was possible and is not there, it hides nothing
        there = min(float(powers[1:].sum()), self.total)
        return bool(np.any(large & (powers - self.expected > policy.part * there)))

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
    from scipy.signal.windows import tukey

    count, dt = view.measured.size, view.dt * view.stride
    voltage = view.pick(view.voltage)
    amplitude = 0.5 * float(np.ptp(view.voltage[view.origin :]))
    noise = view.noise if isfinite(view.noise) else known.noise
    missed = known.near(view.frequency, amplitude)
    lines, line_of = drive_lines(voltage, dt, view.frequency, policy.periods, policy.steady)
    frequency = np.asarray(np.fft.rfftfreq(count, dt), dtype=np.float64)
    octave_of = np.full(frequency.size, _ORDERS, dtype=np.int64)
    octave_of[1:] += np.floor(np.log2(np.arange(1, frequency.size))).astype(np.int64)
    parts = int(octave_of.max()) + 1
    angle = 2.0 * np.pi * dt
    beside = missed.density(frequency) * (frequency[1] * stroke**2)
    white = noise**2 / frequency.size * spectrum_of_noise(view.noise_colour, angle * frequency)
    by_noise: FloatArray = np.bincount(octave_of, white, parts).astype(np.float64)
    ranks = np.bincount(line_of, minlength=parts)
    orders = view.frequency * np.arange(_ORDERS, dtype=np.float64)
    at_lines = noise**2 / count * spectrum_of_noise(view.noise_colour, angle * orders)
    by_noise[:_ORDERS] += ranks[:_ORDERS] * at_lines
    by_model: FloatArray = np.bincount(octave_of, beside, parts).astype(np.float64)
    repeated, known_lines = _repeating(voltage, dt, view.frequency, known, stroke)
    if repeated is None:
        known_lines = {n: (share * stroke) ** 2 for n, share in missed.harmonics.items()}
        repeated = np.zeros(count)
    reach = amplitudes(voltage, dt, view.frequency) if view.frequency > 0.0 else np.zeros(1)
    moves = float(np.mean((reach / max(float(reach.max()), 1e-300)) ** 2))
    for order, share in missed.scatter.items():
        known_lines[order] = known_lines.get(order, 0.0) + moves * (share * stroke) ** 2
    for order, square in known_lines.items():
        if ranks[order]:
            by_model[order] += square
        elif order:  # too few periods for a line
            near = _octaves_near(order * view.frequency * count * dt, parts - _ORDERS)
            by_model[_ORDERS:] += square * near
    total = (missed.share * stroke) ** 2
    open_to = min(total, sum(known_lines.values()) + float(beside.sum()))
    independent = np.minimum(2 * np.bincount(octave_of, minlength=parts), policy.octave)
    independent[:_ORDERS] = np.minimum(ranks[:_ORDERS], policy.line)
    window = np.asarray(tukey(count, policy.taper), dtype=np.float64)
    found = Expectation(
        lines,
        line_of,
        octave_of,
        np.zeros(parts),
        independent.astype(np.float64),
        window,
        repeated,
        known.octaves_from(view.frequency, amplitude),
    )
    seen = stretches_of(known.traces, view.voltage[view.first :], view.dt, view.stride)
    if seen is not None:
        found = replace(found, repeated=seen.mean(axis=0))
        by_model = _beyond_the_mean(found, seen, by_noise)
    anywhere = policy.shape * open_to + LEAST_POWER * total
    expected = np.where(independent > 0, by_noise + by_model + anywhere, 0.0)
    # how the mean follows the amplitude no file of steady drives tells
    expected[0] += total
    return replace(found, expected=expected + 1e-14 * stroke**2 + 1e-300)


def _beyond_the_mean(found: Expectation, seen: FloatArray, by_noise: FloatArray) -> FloatArray:
    """Return by which mean square what is left may differ from its mean over stretches.

    That mean holds their noise, and what one stretch leaves is not quite what another does.
    Stretches overlap, so that they differ rather too little.
    """
    count = len(seen)
    least = by_noise / count
    if count == 1:
        return least
    apart = sum(found.powers(each - found.repeated) for each in seen) / (count - 1)
    return np.maximum(least, (1.0 + 1.0 / count) * apart - by_noise)


# Amplitudes at which what is missed of a growing drive is worked out, between them it is linear.
_STEPS = 32


def _repeating(
    voltage: FloatArray, dt: float, drive: float, known: Discrepancy, stroke: float
) -> tuple[FloatArray | None, dict[int, float]]:
    """Return what a model will miss of a drive, and the mean square by which it may be off.

    Returns
    -------
    repeated : ndarray, shape (n,), or None
        Sum of the harmonics that are expected [m]; None where phases are not known, or the drive
        shows none.
    squares : dict of int to float
        By order [m^2].
    """
    if drive <= 0.0 or drive * dt * voltage.size < 1.0:
        return None, {}
    reach = amplitudes(voltage, dt, drive)
    most = max(float(reach.max()), 1e-300)
    levels = most * np.linspace(1.0 / _STEPS, 1.0, _STEPS)
    found = known.repeats(drive, levels)
    if found is None:
        return None, {}
    turn = phase_of(drive, dt, voltage.size) + phase_at(voltage, dt, drive)
    repeated, squares = np.zeros(voltage.size), {}
    shown = {n: each for n, each in found.items() if n * drive * dt < 0.45}
    for order, each in shown.items():
        phasor = np.interp(reach, levels, each.mean) * np.exp(1j * order * turn)
        repeated += sqrt(2.0) * stroke * (reach / most) * np.real(phasor)
        squares[order] = stroke**2 * float(np.mean(np.interp(reach, levels, each.square)))
    return repeated, squares


def _octaves_near(bin_of_line: float, octaves: int) -> FloatArray:
    """Return in which octaves of a short record a line may lie, shape (octaves,).

    It leaks into the neighbours; a drive that does not repeat (bin 0) leaves it anywhere.
    """
    if bin_of_line <= 0.0:
        return np.full(octaves, 1.0 / octaves)
    place = min(max(int(np.floor(np.log2(max(bin_of_line, 1.0)))), 0), octaves - 1)
    near = np.abs(np.arange(octaves) - place)
    return np.where(near == 0, 1.0, np.where(near == 1, 0.5, 0.0))


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
