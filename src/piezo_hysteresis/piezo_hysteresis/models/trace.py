"""Residuals of a model on available records, sample by sample.

For a repeated drive the discrepancy of the model repeats, including its aperiodic part. It is
subtracted from the residual of the new record, and the remainder is the new deviation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray

#: Largest rms difference of the voltage from that of a section, relative to its standard
#: deviation. Chosen: amplifiers and their monitors repeat a waveform to some tenths of a percent.
SAME = 0.02
#: Largest number of sections, the most similar first: noise decreases with its square root.
MOST = 32
_SAME_RATE = 1e-6


@dataclass(frozen=True)
class Trace:
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
    traces: Iterable[Trace], voltage: FloatArray, dt: float, stride: int = 1
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
