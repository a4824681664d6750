"""Period of a drive, and the first sample from which it is periodic."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.records import Record

Result = TypeVar('Result')

PERIODIC = 1e-3  # scatter of the voltage over its rms up to which it counts as periodic


def cached_per_record(function: Callable[[Record], Result]) -> Callable[[Record], Result]:
    """Return `function` with its result cached per record; records are immutable."""
    known: WeakKeyDictionary[Record, Result] = WeakKeyDictionary()

    def cached(record: Record) -> Result:
        if record not in known:
            known[record] = function(record)
        return known[record]

    cached.__doc__ = function.__doc__
    return cached


@cached_per_record
def period_of(record: Record) -> int:
    """Return the smallest period of the voltage in samples, 0 if it is not periodic.

    Uses the second half of the record, so that a start-up does not hide the period.
    """
    u = record.voltage[len(record) // 2 :]
    n = u.size
    power = float(np.mean((u - u.mean()) ** 2))
    if n < 8 or power <= 1e-30 * max(1.0, float(np.max(np.abs(u))) ** 2):
        return 0
    centred = u - u.mean()
    lags = 1 + np.flatnonzero(mean_changes(centred) < PERIODIC**2 * power)
    exact = _smallest(centred, lags, 1e-9 * sqrt(power))
    return exact or _smallest(centred, lags, PERIODIC * sqrt(power))


def mean_changes(centred: FloatArray) -> FloatArray:
    """Return the mean square of ``u(k + lag) - u(k)`` for the lags 1 to n // 2 of a signal."""
    n = centred.size
    size = 1 << (2 * n - 1).bit_length()
    correlation = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(1, n // 2 + 1)
    energy = squares[n - lags] + squares[n] - squares[lags]
    return np.asarray((energy - 2.0 * correlation[lags]) / (n - lags))


def _smallest(u: FloatArray, lags: IntArray, limit: float) -> int:
    for lag in lags:
        if sqrt(float(np.mean((u[lag:] - u[:-lag]) ** 2))) < limit:
            return int(lag)
    return 0


def periodic_from(u: FloatArray, period: int) -> int:
    """Return the first sample from which the voltage is periodic to the end."""
    change = np.abs(u[period:] - u[:-period])
    limit = 6 * PERIODIC * float(np.std(u[u.size // 2 :]))
    broken = np.flatnonzero(change > limit)
    return int(broken[-1]) + 1 if broken.size else 0
