"""What a model left of records at hand, sample by sample.

Where a drive comes again, what the model misses comes again with it, not only in its harmonics.
Then nothing of it has to be known beforehand: it is taken off, and what remains is what is new.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray

#: Rms by which a voltage may differ from that of a stretch, over its standard deviation. Chosen:
#: amplifiers and their monitors repeat a waveform to some tenths of a percent.
SAME = 0.02
#: Stretches that count, the nearest first: noise falls with their root. Effort.
MOST = 32
_SAME_RATE = 1e-6


@dataclass(frozen=True)
class Trace:
    """What is left of one record after its warm-up.

    Attributes
    ----------
    voltage : ndarray, shape (n,)
        What drove it [V or N].
    error : ndarray, shape (n,)
        Measured minus simulated [m].
    dt : float
        Sampling interval [s].
    begins : str
        The way in which the record was taken to start, '' where it is not known.
    """

    voltage: FloatArray
    error: FloatArray
    dt: float
    begins: str = ''

    def began_similarly(self, voltage: FloatArray, dt: float, begins: str) -> bool:
        """Return whether the record began in a way, with a voltage as far off as in `stretches`.

        What is constant in it counts for nothing here.
        """
        count = min(voltage.size, self.voltage.size)
        off = self.voltage[:count] - voltage[:count]
        same = float(np.std(off)) <= SAME * float(np.std(voltage[:count]))
        return same and self.begins == begins and self._has_rate_of(dt)

    def stretches(self, voltage: FloatArray, dt: float) -> list[tuple[float, FloatArray]]:
        """Return where the same voltage was applied: how far it is off [V] and what was left.

        Parameters
        ----------
        voltage : ndarray, shape (m,)
            The one looked for [V or N].
        dt : float
            Its sampling interval [s].
        """
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
    """Return what was left under the same voltage, shape (k, m), the nearest first [m].

    Parameters
    ----------
    traces : iterable of Trace
        What is at hand.
    voltage, dt
        As in `Trace.stretches`.
    stride : int
        Of the samples that are returned.

    Returns
    -------
    ndarray or None
        None where the voltage was nowhere applied.
    """
    found = [each for trace in traces for each in trace.stretches(voltage, dt)]
    found.sort(key=lambda pair: pair[0])
    return np.array([error[::stride] for _, error in found[:MOST]]) if found else None


def _distances(long: FloatArray, short: FloatArray) -> FloatArray:
    """Return the rms by which `short` differs from each stretch of `long`, shape (n - m + 1,)."""
    from scipy.signal import correlate

    squares = np.concatenate([[0.0], np.cumsum(long**2)])
    power = squares[short.size :] - squares[: squares.size - short.size]
    across = correlate(long, short, mode='valid', method='auto')
    left = power - 2.0 * across + float(short @ short)
    return np.asarray(np.sqrt(np.maximum(left, 0.0) / short.size))
