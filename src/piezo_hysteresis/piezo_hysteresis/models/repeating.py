"""Gaussian process for the repeatable part of a model discrepancy.

The harmonics of an error, relative to the phase of the drive, change smoothly with frequency and
amplitude. A Gaussian process over octaves of frequency and amplitude with exponential correlation
predicts them under other conditions, with their uncertainty. The correlation length is inferred
from the conditions, separately for each harmonic, because a third harmonic may meet a mode that
the first does not: every length is weighted by its likelihood. A harmonic without data may still
appear elsewhere, so its usual power counts as one additional condition.

A fit makes the fundamental of its own conditions small, but not that of others: gain and phase
absorb the fundamental of one condition, which is therefore not counted. The usual power is that of
the higher harmonics, distributed over the orders with the decay of a discontinuous curve, the
slowest of a loop: with the square of the order.

Source: Rasmussen, Williams: Gaussian Processes for Machine Learning, MIT Press 2006, eq. 2.23-2.25
and 5.8, for circular complex numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.numerics.linalg import symmetric_eigen

#: Largest rms difference of the voltage from that of a section, relative to its standard
#: deviation. Chosen: amplifiers and their monitors repeat a waveform to some tenths of a percent.
SAME = 0.02
#: Largest number of sections, the most similar first: noise decreases with its square root.
MOST = 32
_SAME_RATE = 1e-6


@dataclass(frozen=True)
class KnownResidual:
    """Residual on one record after its warm-up."""

    voltage: FloatArray  # input [V or N], shape (n,)
    error: FloatArray  # measured minus simulated [m], shape (n,)
    dt: float  # sampling interval [s]
    begins: str = ''  # assumed initial condition of the record, '' if unknown

    def began_similarly(self, voltage: FloatArray, dt: float, begins: str) -> bool:
        """Return whether the record began alike, with a similar voltage as in `stretches`.

        A constant difference of the voltage is ignored.
        """
        count = min(voltage.size, self.voltage.size)
        off = self.voltage[:count] - voltage[:count]
        same = float(np.std(off)) <= SAME * float(np.std(voltage[:count]))
        return same and self.begins == begins and self._has_rate_of(dt)

    def stretches(self, voltage: FloatArray, dt: float) -> list[tuple[float, FloatArray]]:
        """Return sections with the same voltage: rms difference [V] and residual of each."""
        # voltage [V or N] (m,); dt [s]
        scale = float(np.std(voltage))
        if not self._has_rate_of(dt) or voltage.size > self.voltage.size or scale == 0.0:
            return []
        off = _distances(self.voltage, voltage)
        near = np.flatnonzero(off <= SAME * scale)
        runs = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if near.size else []
        best = [int(run[np.argmin(off[run])]) for run in runs]
        return [(float(off[lag]), self.error[lag : lag + voltage.size]) for lag in best]

    def _has_rate_of(self, dt: float) -> bool:
        return abs(dt / self.dt - 1.0) <= _SAME_RATE


def stretches_of(
    traces: Iterable[KnownResidual], voltage: FloatArray, dt: float, stride: int = 1
) -> FloatArray | None:
    """Return the residuals under the same voltage, shape (k, m), the most similar first [m]."""
    found = [each for trace in traces for each in trace.stretches(voltage, dt)]
    found.sort(key=lambda pair: pair[0])
    return np.array([error[::stride] for _, error in found[:MOST]]) if found else None


def _distances(long: FloatArray, short: FloatArray) -> FloatArray:
    """Return the rms difference of `short` from each section of `long`, shape (n - m + 1,)."""
    from scipy.signal import correlate

    squares = np.concatenate([[0.0], np.cumsum(long**2)])
    power = squares[short.size :] - squares[: squares.size - short.size]
    across = correlate(long, short, mode='valid', method='auto')
    left = power - 2.0 * across + float(short @ short)
    return np.asarray(np.sqrt(np.maximum(left, 0.0) / short.size))


#: Correlation lengths of errors [octaves], of frequency and of amplitude.
LENGTHS = (0.25, 1.0, 4.0)
#: Share of the mean square that does not repeat with the same phase under one condition: a tenth
#: of the rms. Chosen; repetitions of measured sweeps differ by some hundredths.
ANEW = 0.01
# Decay of the power of the harmonics of a loop with their order.
_DECAY = 2.0
_NOTHING = 1e-30  # mean square relative to that of the stroke
_FAR = 16.0  # distance of a drive from no drive [octaves]


@dataclass(frozen=True)
class Repeating:
    """One harmonic of the discrepancy at several amplitudes of a drive.

    Attributes
    ----------
    mean : ndarray of complex, shape (n,)
        Expectation, in rms and phase relative to the drive.
    square : ndarray, shape (n,)
        Mean square uncertainty.
    """

    mean: ComplexArray
    square: FloatArray


def usual_powers(phasors: ComplexArray) -> FloatArray:  # phasors (n, conditions)
    """Return the mean square of each harmonic that is usual under other conditions, shape (n,)."""
    shape = np.arange(1.0, len(phasors) + 1.0) ** -_DECAY
    above = float(np.sum(np.mean(np.abs(phasors[1:]) ** 2, axis=1)))
    return np.asarray(shape * above / max(float(shape[1:].sum()), _NOTHING))


def repeating(
    places: FloatArray, phasors: ComplexArray, wanted: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return the prediction of phasors under other conditions."""
    # places (n, 2); phasors (orders, n); wanted (m, 2) -> mean (orders, m), square (orders, m)
    count = len(places)
    counted = np.full(len(phasors), count + 1.0)
    counted[0] -= 1.0  # absorbed by the fit
    known, new = _octaves(places, places), _octaves(wanted, places)
    usual, mean_power = usual_powers(phasors), float(np.mean(np.abs(phasors) ** 2))
    means, squares, scores = [], [], []
    for lengths in ((f, a) for f in LENGTHS for a in LENGTHS):
        inside = np.exp(-(known / lengths).sum(axis=-1)) + ANEW * np.eye(count)
        across = np.exp(-(new / lengths).sum(axis=-1))
        inverse, spread = _inverse(inside)
        gain = across @ inverse
        mean = phasors @ gain.T
        seen = np.real(np.sum(phasors.conj() * (phasors @ inverse), axis=1))
        scale = (seen + usual) / counted
        anew = ANEW * (seen + mean_power) / (count + 1.0)
        left = 1.0 - np.sum(gain * across, axis=1)
        means.append(mean)
        squares.append(np.outer(scale, np.maximum(left, 0.0)) + anew[:, None])
        scores.append(-count * np.log(np.maximum(scale, _NOTHING)) - spread)
    weight = np.exp(np.array(scores) - np.max(scores, axis=0))
    weight = (weight / weight.sum(axis=0))[:, :, None]
    each, spread_of = np.array(means), np.array(squares)
    mean = np.sum(weight * each, axis=0)
    return mean, np.sum(weight * (spread_of + np.abs(each - mean) ** 2), axis=0)


def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a correlation and the logarithm of its determinant."""
    found = symmetric_eigen(matrix)
    if found is None:
        raise ModelError('the conditions of the discrepancy cannot be compared; identify again')
    size = np.maximum(found[0], ANEW)
    return np.asarray((found[1] / size) @ found[1].T), float(np.sum(np.log(size)))


def _octaves(wanted: FloatArray, known: FloatArray) -> FloatArray:
    """Return the distances in frequency and amplitude, shape (m, n, 2) [octaves]."""
    with np.errstate(divide='ignore', invalid='ignore'):
        apart = np.abs(np.log2(wanted)[:, None, :] - np.log2(known)[None, :, :])
    same = wanted[:, None, :] == known[None, :, :]
    return np.where(same, 0.0, np.minimum(np.nan_to_num(apart, posinf=_FAR), _FAR))


def of_orders(
    orders: Sequence[int], mean: ComplexArray, square: FloatArray
) -> dict[int, Repeating]:
    """Return the rows of `repeating` by order."""
    return {n: Repeating(m, s) for n, m, s in zip(orders, mean, square, strict=True)}
