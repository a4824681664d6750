"""The noise floor: what no model can explain, measured without a model.

Periods of a record are compared with the period before, so that everything that repeats drops
out; what is left is judged by its running median spectrum, so that a tone, a drift or a few
bursts, which a better model may well explain, do not count as noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.dataset import Dataset
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.targets import periodic_from
from piezo_hysteresis.records import Record

# Median of a periodogram of white noise over its mean.
MEDIAN = float(np.log(2.0))
WIDTH = 101
# The same for a median over so few lines of a windowed spectrum, of which half are independent.
RUNNING_MEDIAN = 0.704
# Standard deviation of an rms from one line of a spectrum by its median: 1 / (2 ln 2).
SPREAD = 0.72
# Records whose noise differs by less than this from most are the same.
AGREE = 0.02
# Length of the blocks by which improvements are judged [s], and how many there should be.
BLOCK = 0.3
FEWEST_BLOCKS = 40


@dataclass(frozen=True)
class Noise:
    """What one record shows of the noise.

    Attributes
    ----------
    rms : float
        Of the noise [m]; NaN where it cannot be told.
    lines : int
        Independent lines of the spectrum that it was taken from, half of those of a windowed one:
        it is known to about ``0.72 / sqrt(lines)``.
    """

    rms: float
    lines: int

    @property
    def doubt(self) -> float:
        """Standard deviation of the mean square, as a share of it."""
        return 2.0 * SPREAD / float(np.sqrt(self.lines))


NOT_TOLD = Noise(float('nan'), 0)


def noise_floor(data: Dataset) -> Noise:
    """Return the noise, pooled over the records.

    Records that agree with most within their own uncertainty are averaged; one in which transients
    or the drive leak into the noise does not count.

    Raises
    ------
    IdentificationError
        If no record lets it be seen.
    """
    found = [record_noise(record, data.periods[record.name]) for record in data.records]
    known = [noise for noise in found if noise.lines]
    if not known:
        raise IdentificationError(
            'no record shows the noise: record at least two periods of each excitation, or some '
            'seconds at rest'
        )
    return consensus(known)


def consensus(found: Sequence[Noise]) -> Noise:
    """Return the noise on which most records agree; each counts by its lines."""
    rms = np.array([noise.rms for noise in found])
    lines = np.array([noise.lines for noise in found])
    order = np.argsort(rms)
    share = np.cumsum(lines[order]) / np.sum(lines)
    middle = float(rms[order][np.searchsorted(share, 0.5)])
    trusted = np.abs(rms - middle) <= middle * (AGREE + 3.0 * SPREAD / np.sqrt(lines))
    mean_square = float(np.average(rms[trusted] ** 2, weights=lines[trusted]))
    return Noise(float(np.sqrt(mean_square)), int(lines[trusted].sum()))


def record_noise(record: Record, period: int) -> Noise:
    """Return the noise of one record."""
    measured = record.displacement[record.warm_up_samples :]
    still = float(np.ptp(record.voltage)) == 0.0
    if still:
        return robust_noise(measured)
    steady = _steady(record, period) if period else measured[:0]
    if period and steady.size >= 2 * period:
        return robust_noise(steady[period:] - steady[:-period], period)
    return high_band_noise(measured, record.voltage[record.warm_up_samples :])


def _steady(record: Record, period: int) -> FloatArray:
    """Return the part of the displacement in which the input repeats and transients are over."""
    first = max(periodic_from(record.voltage, period), record.warm_up_samples)
    if first > record.warm_up_samples and len(record) - first >= 4 * period:
        first += period
    return record.displacement[first:]


def robust_noise(signal: FloatArray, lag: int = 0) -> Noise:
    """Return the noise in `signal`, blind to lines and to slow changes.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        What does not repeat [m].
    lag : int
        Samples after which it was subtracted from itself; 0 where it was not.
    """
    if signal.size < 4 * WIDTH:
        if signal.size <= 8:
            return NOT_TOLD
        # Too short for a running median; half the median of squares is robust enough.
        mean_square = np.median(signal**2) / 0.4549 / (2.0 if lag else 1.0)
        return Noise(float(np.sqrt(mean_square)), signal.size // 4)
    # without a window, a tone between two lines would leak into all of them
    window = np.hanning(signal.size)
    power = np.abs(np.fft.rfft(window * (signal - signal.mean()))) ** 2 / np.sum(window**2)
    gain = _gain_of_difference(window, lag, power.size)
    # where the difference cancels everything there is nothing to see
    kept = np.flatnonzero(gain > 0.3)[2:]
    smooth = median_filter(power[kept] / gain[kept], WIDTH, mode='nearest') / RUNNING_MEDIAN
    return Noise(float(np.sqrt(np.mean(smooth))), kept.size // 2)


def _gain_of_difference(window: FloatArray, lag: int, lines: int) -> FloatArray:
    """Return the mean square of every line of a windowed difference, for white noise of rms 1."""
    if lag == 0:
        return np.ones(lines)
    if lag < window.size:
        alike = float(window[lag:] @ window[:-lag]) / float(window @ window)
    else:
        alike = 0.0
    angle = 2.0 * np.pi * lag * np.arange(lines) / window.size
    return np.asarray(2.0 * (1.0 - alike * np.cos(angle)))


def high_band_noise(measured: FloatArray, voltage: FloatArray) -> Noise:
    """Return the noise of a record that does not repeat: from the band the drive leaves empty."""
    if measured.size < 4 * WIDTH:
        return NOT_TOLD
    window = np.hanning(measured.size)
    drive = np.abs(np.fft.rfft(window * (voltage - voltage.mean()))) ** 2
    power = np.abs(np.fft.rfft(window * (measured - measured.mean()))) ** 2
    total = np.cumsum(drive)
    driven = int(np.searchsorted(total, 0.9999 * total[-1]))
    band = power[max(8 * driven, power.size // 2) :]
    if band.size < WIDTH:
        band = power[-max(power.size // 8, WIDTH) :]
    mean_square = float(np.median(band)) / MEDIAN
    rms = float(np.sqrt(mean_square / np.mean(window**2) / measured.size))
    return Noise(rms, band.size // 2)


def block_edges(
    sizes: Sequence[int], periods: Sequence[int], dts: Sequence[float]
) -> list[list[int]]:
    """Return the edges of blocks of whole periods, some 0.3 s or more, per view.

    Few slow periods make too few blocks to judge anything by; then parts of periods are taken.
    """
    lengths = []
    for period, dt in zip(periods, dts, strict=True):
        block = max(round(BLOCK / dt), 1)
        lengths.append(period * max(1, round(block / period)) if period else block)
    blocks = sum(size / length for size, length in zip(sizes, lengths, strict=True))
    shrink = min(1.0, blocks / FEWEST_BLOCKS)
    edges = []
    for size, length in zip(sizes, lengths, strict=True):
        count = max(1, int(size // max(shrink * length, 1.0)))
        edges.append([k * size // count for k in range(count + 1)])
    return edges
