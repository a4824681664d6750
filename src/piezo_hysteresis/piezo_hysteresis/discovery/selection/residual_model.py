"""Expected residual power of a model with a known discrepancy, per harmonic and octave.

The discrepancy of a model repeats with the drive. A harmonic of ten thousand samples holds two
independent numbers, not ten thousand, so evidence is counted per harmonic and per octave. A
residual is decomposed into the harmonics of the drive and into octaves of the remaining spectrum;
the power of each part is compared with the expectation from the noise and from the discrepancy of
the ``model.yaml``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray, IntArray
from piezo_hysteresis.discovery.selection.policy import HELD, SelectionPolicy
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.model_discrepancy import (
    LEAST_POWER,
    amplitudes,
    drive_lines,
    drive_turn,
    octaves_of,
    waveform_of,
)
from piezo_hysteresis.identification.noise import density as spectrum_of_noise
from piezo_hysteresis.models import Discrepancy
from piezo_hysteresis.models.repeating import stretches_of
from piezo_hysteresis.numerics.harmonics import HIGHEST_ORDER, ModulatedLines

# Parts of a residual: harmonic orders 0 to the highest, then octaves.
_ORDERS = HIGHEST_ORDER + 1


@dataclass(frozen=True)
class Expectation:
    """Expected residual power of one view, per harmonic and octave."""

    lines: ModulatedLines | None  # the harmonics of the drive, scaled with its amplitude
    octave_of: IntArray  # (bins,)
    expected: FloatArray  # expected mean square of each part [m^2], shape (parts,)
    independent: FloatArray  # number of independent values in each part, shape (parts,)
    window: FloatArray  # weight of each sample in the spectrum, shape (n,)
    repeated: FloatArray  # known discrepancy under this drive [m], shape (n,)
    octaves: float  # [octaves]
    repeats: bool = False  # whether repeated records of this drive show how much it varies

    @property
    def total(self) -> float:
        """Expected mean square over all parts except the mean [m^2]."""
        return float(self.expected[1:].sum())

    def out_of_phase(self) -> Expectation:
        """Return the expectation for a known discrepancy with unknown phases."""
        return replace(self, expected=self.expected + self.powers(self.repeated))

    def powers(self, error: FloatArray) -> FloatArray:
        """Return the residual power per harmonic and octave of an error of shape (n,) [m^2].

        The mean is excluded, because the zero offset of a record is a nuisance parameter.
        """
        if not np.all(np.isfinite(error)):
            return np.full(self.expected.size, np.inf)
        shares, spectrum = self._components(error)
        found = np.bincount(_orders_of(self.lines), shares**2, self.expected.size)
        power = np.abs(spectrum) ** 2
        return np.asarray(found + np.bincount(self.octave_of, power, found.size))

    def whitened(self, change: FloatArray) -> FloatArray:
        """Return the components of a change of shape (n,), in standard deviations.

        Half the sum of their squares is the loss of log likelihood by a small change: each part
        counts as its number of independent values, with the expected power as variance.
        """
        known = self.expected > 0.0
        return self._weighed(
            change, self.independent * known / np.where(known, self.expected, 1.0)
        )

    def whitening(self, error: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Return a function that whitens changes of a residual of shape (n,).

        The weight of each part is the slope of `cost` at its power, so the squared norm of the
        whitened residual decreases as `cost` does, to first order.
        """
        power = self.expected + np.maximum(self.powers(error), self.expected)
        weights = self.independent / np.where(power > 0.0, power, 1.0)
        return lambda change: self._weighed(change, weights)

    def _weighed(self, change: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the components of a change, whose squares are weighed by part."""
        shares, spectrum = self._components(change)
        roots = np.sqrt(weights)
        broadband = spectrum * roots[self.octave_of]
        return np.concatenate(
            [shares * roots[_orders_of(self.lines)], broadband.real, broadband.imag]
        )

    def _components(self, error: FloatArray) -> tuple[FloatArray, ComplexArray]:
        """Return the share of each of the `lines` and the spectrum of the rest [m].

        Their squares are mean squares, and their sum is that of the error without its mean.
        """
        shares, broadband = np.zeros(0), error - error.mean()
        if self.lines is not None:
            shares, broadband = self.lines.split(broadband)
        spectrum = np.fft.rfft(self.window * broadband)
        spectrum[0] = 0.0
        size = np.sqrt(float(self.window @ self.window) * spectrum.size)
        return shares / np.sqrt(error.size), spectrum / size

    def cost(self, powers: FloatArray, policy: SelectionPolicy = HELD) -> float:
        """Return the negative log likelihood of the residual powers, up to a constant [nats].

        The expected power of each part is itself estimated, from about as many values as the part
        has, so the tails are those of Student's distribution. The total power is weighted in
        addition. A power below its expectation is no evidence: an effect that reduces the known
        discrepancy explains no new deviation.
        """
        if not np.all(np.isfinite(powers)):
            return float('inf')
        parts = np.maximum(powers / self.expected, 1.0)
        whole = policy.whole * float(np.log1p(max(powers[1:].sum() / self.total, 1.0)))
        return float(self.independent @ np.log1p(parts)) + whole

    def new_deviation(self, powers: FloatArray, policy: SelectionPolicy = HELD) -> bool:
        """Return whether the residual powers exceed the known discrepancy (a new deviation)."""
        if not powers[1:].sum() <= policy.new_deviation**2 * self.total:
            return True
        chance = 1.0 + 3.0 / np.sqrt(np.maximum(self.independent, 1.0))
        large = powers > chance * policy.new_deviation**2 * self.expected
        # an expected part that is absent from the residual must not mask a new deviation
        there = min(float(powers[1:].sum()), self.total)
        return bool(np.any(large & (powers - self.expected > policy.part * there)))

    def excess(self, powers: FloatArray) -> float:
        """Return the mean square beyond the expectation, relative to the total expectation [1]."""
        return float(np.maximum(powers - self.expected, 0.0).sum() / self.total)


def _orders_of(lines: ModulatedLines | None) -> IntArray:
    return np.zeros(0, dtype=np.int64) if lines is None else lines.orders


def expectation(
    view: FitData, known: Discrepancy, stroke: float, policy: SelectionPolicy = HELD
) -> Expectation:  # stroke [m]
    """Return the expected residual power of a view for a model with the discrepancy `known`."""
    from scipy.signal.windows import tukey

    count, dt = view.measured.size, view.dt * view.stride
    voltage = view.pick(view.voltage)
    amplitude = 0.5 * float(np.ptp(view.voltage[view.origin :]))
    noise = view.noise if isfinite(view.noise) else known.noise
    missed = known.near(view.frequency, amplitude)
    kind = known.repeated(view.frequency, amplitude)
    if kind is not None:  # of the same drive sizes are known, and a new effect changes the stroke
        stroke = kind.stroke
    lines = drive_lines(voltage, dt, view.frequency, policy.periods, policy.steady)
    frequency = np.asarray(np.fft.rfftfreq(count, dt), dtype=np.float64)
    octave_of = np.full(frequency.size, _ORDERS, dtype=np.int64)
    octaves, base = octaves_of(count, dt, view.frequency)
    lowest = int(octaves.min(initial=0))
    octave_of[1:] += octaves - lowest
    parts = int(octave_of.max()) + 1
    angle = 2.0 * np.pi * dt
    broadband = missed.density(frequency) * (frequency[1] * stroke**2)
    white = (
        noise**2 / frequency.size * spectrum_of_noise(view.noise_colour, np.cos(angle * frequency))
    )
    by_noise: FloatArray = np.bincount(octave_of, white, parts).astype(np.float64)
    ranks = np.bincount(_orders_of(lines), minlength=parts)
    orders = view.frequency * np.arange(_ORDERS, dtype=np.float64)
    at_lines = noise**2 / count * spectrum_of_noise(view.noise_colour, np.cos(angle * orders))
    by_noise[:_ORDERS] += ranks[:_ORDERS] * at_lines
    by_model: FloatArray = np.bincount(octave_of, broadband, parts).astype(np.float64)
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
        elif order:  # too few periods to resolve the harmonic
            ratio = order * view.frequency / base
            place = int(np.floor(np.log2(ratio))) - lowest if ratio > 0.0 else None
            near = _octaves_near(place, parts - _ORDERS)
            by_model[_ORDERS:] += square * near
    total = (missed.share * stroke) ** 2
    open_to = min(total, sum(known_lines.values()) + float(broadband.sum()))
    independent = np.minimum(2 * np.bincount(octave_of, minlength=parts), policy.octave)
    independent[:_ORDERS] = np.minimum(ranks[:_ORDERS], policy.line)
    window = np.asarray(tukey(count, policy.taper), dtype=np.float64)
    found = Expectation(
        lines,
        octave_of,
        np.zeros(parts),
        independent.astype(np.float64),
        window,
        repeated,
        known.octaves_from(view.frequency, amplitude),
        kind is not None,
    )
    if view.frequency > 0.0 and not known.has_form(waveform_of(voltage, dt, view.frequency)):
        by_model += found.powers(repeated)  # under another waveform it has other phases
        found = replace(found, repeated=np.zeros(count))
    # one record does not show which part of what the model misses repeats on the next one
    by_model += missed.anew * (by_model + found.powers(found.repeated))
    seen = stretches_of(known.traces, view.voltage[view.first :], view.dt, view.stride)
    if seen is not None:
        found = replace(found, repeated=seen.mean(axis=0))
        by_model = _beyond_the_mean(found, seen, by_noise)
    anywhere = policy.shape * open_to + LEAST_POWER * total
    expected = np.where(independent > 0, by_noise + by_model + anywhere, 0.0)
    # a file from steady drives does not contain the dependence of the mean on the amplitude
    expected[0] += total
    return replace(found, expected=expected + 1e-14 * stroke**2 + 1e-300)


def _beyond_the_mean(found: Expectation, seen: FloatArray, by_noise: FloatArray) -> FloatArray:
    """Return the mean square by which the residual may deviate from its mean over stretches.

    The mean contains the noise of the stretches, and the residual varies between stretches. The
    stretches overlap, so their variance is a low estimate.
    """
    count = len(seen)
    least = by_noise / count
    if count == 1:
        return least
    apart = sum(found.powers(each - found.repeated) for each in seen) / (count - 1)
    return np.maximum(least, (1.0 + 1.0 / count) * apart - by_noise)


# Number of amplitudes at which the discrepancy is evaluated, with linear interpolation between.
_STEPS = 32


def _repeating(
    voltage: FloatArray, dt: float, drive: float, known: Discrepancy, stroke: float
) -> tuple[FloatArray | None, dict[int, float]]:
    """Return the expected discrepancy [m] and its mean square uncertainty by harmonic [m^2].

    The signal is None if phases are unknown or the record has no drive frequency.
    """
    if drive <= 0.0 or drive * dt * voltage.size < 1.0:
        return None, {}
    reach = amplitudes(voltage, dt, drive)
    most = max(float(reach.max()), 1e-300)
    levels = most * np.linspace(1.0 / _STEPS, 1.0, _STEPS)
    found = known.repeats(drive, levels)
    if found is None:
        return None, {}
    turn = drive_turn(voltage, dt, drive)
    repeated, squares = np.zeros(voltage.size), {}
    shown = {n: each for n, each in found.items() if n * drive * dt < 0.45}
    for order, each in shown.items():
        phasor = np.interp(reach, levels, each.mean) * np.exp(1j * order * turn)
        repeated += sqrt(2.0) * stroke * (reach / most) * np.real(phasor)
        squares[order] = stroke**2 * float(np.mean(np.interp(reach, levels, each.square)))
    return repeated, squares


def _octaves_near(place: int | None, octaves: int) -> FloatArray:
    """Return the share of a harmonic's power in each octave of a short record, shape (octaves,).

    The line leaks into the neighbouring octaves. Without a drive (None) it may be in any.
    """
    if place is None:
        return np.full(octaves, 1.0 / octaves)
    near = np.abs(np.arange(octaves) - min(max(place, 0), octaves - 1))
    return np.where(near == 0, 1.0, np.where(near == 1, 0.5, 0.0))


def costs(
    errors: Sequence[FloatArray], expected: Sequence[Expectation]
) -> tuple[float, float, bool]:
    """Return the cost [nats], the excess [1] and whether any view has a new deviation."""
    pairs = [(e, e.powers(error)) for e, error in zip(expected, errors, strict=True)]
    return (
        sum(e.cost(p) for e, p in pairs),
        sum(e.excess(p) for e, p in pairs),
        any(e.new_deviation(p) for e, p in pairs),
    )
