"""Annotation of records with unknown excitation, from the input signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.harmonics import phase_of
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.records import Record

# Share of the input power that one sinusoid must explain to count as a pure sinusoid.
PURE = 0.999


def annotated(records: Sequence[Record]) -> list[Record]:
    """Return the records with missing excitation types and frequencies filled in.

    Files without markers (CSV, external bags) do not contain the waveform. An input at rest and a
    pure sinusoid are recognized; every other input stays unknown.
    """
    return [_annotated(record) for record in records]


def _annotated(record: Record) -> Record:
    info = record.info
    if info.excitation not in ('', 'unknown'):
        return record
    if float(np.ptp(record.voltage)) == 0.0:
        return replace(record, info=replace(info, excitation='rest'))
    frequency = sine_frequency(record.voltage, record.dt)
    if frequency == 0.0:
        return record
    amplitude = info.amplitude or float(np.max(np.abs(record.voltage - record.voltage.mean())))
    known = replace(info, excitation='sine', frequency=frequency, amplitude=amplitude)
    return replace(record, info=known)


def sine_frequency(voltage: FloatArray, dt: float) -> float:
    """Return the frequency of a pure sinusoid [Hz], 0 for any other input."""
    centred = voltage - voltage.mean()
    n = centred.size
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(n)))
    place = int(np.argmax(spectrum))
    if not 1 < place < spectrum.size - 1:
        return 0.0
    # Between the spectral lines: minimum of the residual of a fitted sinusoid.
    low, high = (place - 1) / (n * dt), (place + 1) / (n * dt)
    for _ in range(40):
        third = (high - low) / 3.0
        if _left(voltage, dt, low + third) < _left(voltage, dt, high - third):
            high -= third
        else:
            low += third
    frequency = 0.5 * (low + high)
    if _left(voltage, dt, frequency) > (1.0 - PURE) * float(centred @ centred):
        return 0.0
    cleaned = float(f'{frequency:.4g}')
    return cleaned if abs(cleaned - frequency) < 0.02 / (n * dt) else frequency


def _left(voltage: FloatArray, dt: float, frequency: float) -> float:
    angle = phase_of(frequency, dt, voltage.size)
    # normal equations: about eighty calls, and the columns are nearly orthogonal
    basis = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    error = voltage - basis @ solve_square(basis.T @ basis, basis.T @ voltage).values
    return float(error @ error)
