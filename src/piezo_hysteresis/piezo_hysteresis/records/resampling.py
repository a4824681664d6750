"""Records at another rate: those of two rates together, or of stamps that jitter."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.record import Record

# Numerator and denominator of the ratio of two rates are no larger.
FINEST = 200
# Ticks by which two grids may differ over a record and still be one.
SAME = 1e-9


def resampled(record: Record, rate: float) -> Record:  # rate [Hz]
    """Return a record at another rate, after an anti-aliasing filter.

    Input, displacement and reference pass the same zero-phase filter, so that none is shifted
    relative to another.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordError(f'--resample {rate:g}: a rate in Hz is above 0')
    if not 1e-3 <= rate * record.dt <= 1e3:
        raise RecordError(
            f'{record.name}: {record.rate:g} Hz cannot be made {rate:g} Hz: more than a thousand '
            'times fewer or more samples'
        )
    if abs(rate * record.dt - 1.0) < SAME:
        return replace(record, dt=1.0 / rate)
    reference = record.reference
    return replace(
        record,
        dt=1.0 / rate,
        voltage=_at(record.voltage, record.dt, rate),
        displacement=_at(record.displacement, record.dt, rate),
        reference=None if reference is None else _at(reference, record.dt, rate),
    )


def _at(signal: FloatArray, dt: float, rate: float) -> FloatArray:
    """Return a signal at another rate: filtered at a near ratio, interpolated for the rest."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import resample_poly

    ratio = Fraction(rate * dt).limit_denominator(FINEST)
    found = resample_poly(signal, ratio.numerator, ratio.denominator, padtype='line')
    step = dt * ratio.denominator / ratio.numerator
    if abs(step * rate - 1.0) * found.size > SAME:
        time = np.arange(found.size) * step
        instants = np.arange(int(time[-1] * rate) + 1) / rate
        found = CubicSpline(time, found)(instants)
    return np.asarray(found, np.float64)
