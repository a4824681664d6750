"""Annotation of records with unknown excitation, from the input signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.harmonics import without_tone
from piezo_hysteresis.numerics.qr import inner
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
    from scipy.optimize import minimize_scalar

    centred = voltage - voltage.mean()
    n = centred.size
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(n)))
    place = int(np.argmax(spectrum))
    if not 1 < place < spectrum.size - 1:
        return 0.0
    # between the spectral lines: minimum of what a fitted sinusoid leaves
    found = minimize_scalar(
        lambda line: without_tone(centred, line / (n * dt), dt),
        bounds=(place - 1.0, place + 1.0),
        method='bounded',
        options={'xatol': 1e-6},
    )
    frequency = float(found.x) / (n * dt)
    if found.fun > (1.0 - PURE) * inner(centred, centred):
        return 0.0
    cleaned = float(f'{frequency:.4g}')
    return cleaned if abs(cleaned - frequency) < 0.02 / (n * dt) else frequency
