"""The noise floor: what no model can explain, measured without a model.

Periods of a record are compared with the period before, so that everything that repeats drops
out; what is left is judged by its running median spectrum, so that a tone, a drift or a few
bursts, which a better model may well explain, do not count as noise.
"""

from __future__ import annotations

from collections.abc import Sequence

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
# Length of the blocks by which improvements are judged [s], and how many there should be.
BLOCK = 0.3
FEWEST_BLOCKS = 40


def noise_floor(data: Dataset) -> float:
    """Return the rms of the noise [m], pooled over the records.

    Raises
    ------
    IdentificationError
        If no record lets it be seen.
    """
    found = []
    for record in data.records:
        noise = record_noise(record, data.periods[record.name])
        if np.isfinite(noise):
            found.append(noise)
    if not found:
        raise IdentificationError(
            'no record shows the noise: record at least two periods of each excitation, or some '
            'seconds at rest'
        )
    return float(np.median(found))


def record_noise(record: Record, period: int) -> float:
    """Return the rms noise of one record [m], NaN where it cannot be told."""
    measured = record.displacement[record.warm_up_samples :]
    still = float(np.ptp(record.voltage)) == 0.0
    if still:
        return robust_rms(measured - measured.mean())
    steady = _steady(record, period) if period else measured[:0]
    if period and steady.size >= 2 * period:
        pairs = steady[: steady.size // (2 * period) * 2 * period].reshape(-1, 2, period)
        # Each period is used once, so that the differences of white noise are white too.
        change = ((pairs[:, 1] - pairs[:, 0]) / np.sqrt(2.0)).ravel()
        return robust_rms(change - change.mean())
    return high_band_rms(measured, record.voltage[record.warm_up_samples :])


def _steady(record: Record, period: int) -> FloatArray:
    """Return the part of the displacement in which the input repeats and transients are over."""
    first = max(periodic_from(record.voltage, period), record.warm_up_samples)
    if first > record.warm_up_samples and len(record) - first >= 4 * period:
        first += period
    return record.displacement[first:]


def robust_rms(signal: FloatArray) -> float:
    """Return the rms of the noise in `signal`, blind to lines and to slow changes."""
    if signal.size < 4 * WIDTH:
        # Too short for a running median; half the median of squares is robust enough.
        return float(np.sqrt(np.median(signal**2) / 0.4549)) if signal.size > 8 else float('nan')
    power = np.abs(np.fft.rfft(signal)[1:]) ** 2
    smooth = median_filter(power, WIDTH, mode='nearest') / MEDIAN
    return float(np.sqrt(2.0 * smooth.sum()) / signal.size)


def high_band_rms(measured: FloatArray, voltage: FloatArray) -> float:
    """Return the noise of a record that does not repeat: from the band the drive leaves empty."""
    if measured.size < 4 * WIDTH:
        return float('nan')
    window = np.hanning(measured.size)
    drive = np.abs(np.fft.rfft(window * (voltage - voltage.mean()))) ** 2
    power = np.abs(np.fft.rfft(window * (measured - measured.mean()))) ** 2
    total = np.cumsum(drive)
    driven = int(np.searchsorted(total, 0.9999 * total[-1]))
    band = power[max(8 * driven, power.size // 2) :]
    if band.size < WIDTH:
        band = power[-max(power.size // 8, WIDTH) :]
    mean_square = float(np.median(band)) / MEDIAN
    return float(np.sqrt(mean_square / np.mean(window**2) / measured.size))


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
