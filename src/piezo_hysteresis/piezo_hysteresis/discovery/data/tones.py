"""Fixed tones that are independent of the drive, with phases aligned over all records.

Records of one bag share a clock, but a tone need not keep its phase over the pauses between them,
and records of other files often all start at time zero. The phase of a tone is therefore a
nuisance parameter of every record. When a tone is found, the start time of each record is set such
that one sine describes it in all records. Only time-dependent blocks use the start time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.numerics.harmonics import (
    BINS,
    DOMINANT,
    HIGHEST_ORDER,
    non_harmonic_lines,
    resolved_lines,
    tone_amplitude,
    without_tone,
)
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

# Ratio to the local median of the spectrum from which a line is significant.
PROMINENT = 30.0
# Share of the usual amplitude of the tone from which its phase is reliable.
TRUSTED = 0.5
_FEWEST = 256
_STEPS = np.linspace(-1.0, 1.0, 41)

_Seen = tuple[FitData, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Tone:
    """One fixed tone."""

    frequency: float  # frequency in all records [Hz]
    amplitude: float  # median over the records in which the tone is distinct from the drive [m]


def spectrum(view: FitData, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and power of `error` without the harmonics of the drive."""
    frequency, lines = non_harmonic_lines(error, view.dt, view.frequency, trend=True)
    return frequency, lines**2


def phasor(view: FitData, error: FloatArray, frequency: float) -> complex:
    """Return the complex amplitude of a tone [m], with the phase at the first driven sample."""
    return tone_amplitude(error, frequency, view.dt, view.first)


def find_tone(views: Sequence[FitData], errors: Sequence[FloatArray]) -> Tone | None:
    """Return the tone that explains the most power over all views, None if there is none.

    In records of few periods every line is near a harmonic of the drive. A tone is then found if
    it is most of the residual of every record, because their drives have different frequencies.
    """
    long = [(v, e) for v, e in zip(views, errors, strict=True) if e.size > _FEWEST]
    seen = [(v, e, *spectrum(v, e)) for v, e in long]
    return _prominent(seen) or _dominant(seen)


def _prominent(seen: Sequence[_Seen]) -> Tone | None:
    """Return the tone that is far above its neighbours in some records, away from harmonics."""
    found = []
    for _, _, frequency, power in seen:
        top = int(np.argmax(power))
        around = power[max(0, top - 200) : top + 200]
        if power[top] > 0.0 and power[top] > PROMINENT * float(np.median(around[around > 0.0])):
            found.append(float(frequency[top]))
    if len(found) < max(2, len(seen) // 4):
        return None
    best = _refined(found, seen)
    clear = _clear(seen, best)
    if len(clear) < 2:
        return None
    return Tone(best, float(np.median([abs(phasor(v, e, best)) for v, e, _, _ in clear])))


def _dominant(seen: Sequence[_Seen]) -> Tone | None:
    """Return the tone that is most of the residual of records with different drives."""
    if len({view.frequency for view, *_ in seen}) < 2:
        return None
    tops = [float(row[2][np.argmax(resolved_lines(row[1], trend=True))]) for row in seen]
    best = _refined(tops, seen)
    sizes = np.array([abs(phasor(v, e, best)) for v, e, _, _ in seen])
    powers = np.array([float(np.var(e)) for _, e, _, _ in seen])
    if np.any(0.5 * sizes**2 < DOMINANT * powers) or not np.all(powers > 0.0):
        return None
    return Tone(best, float(np.median(sizes)))


def _refined(found: Sequence[float], seen: Sequence[_Seen]) -> float:
    """Return the frequency near the found ones that explains the most power per sample [Hz].

    A sum over the records would favour a frequency that is no harmonic in more of them.
    """

    def explained(tone: float, rows: Sequence[_Seen]) -> float:
        powers = [abs(phasor(v, e, tone)) ** 2 for v, e, _, _ in rows]
        return float(np.average(powers, weights=[e.size for _, e, _, _ in rows]))

    clear = {tone: _clear(seen, tone) for tone in found}
    several = [tone for tone in found if len(clear[tone]) > 1] or found
    best = max(several, key=lambda tone: explained(tone, clear[tone] or seen))
    rows = clear[best] or seen
    longest = max(e.size * v.dt for v, e, _, _ in seen)
    for width in (1.0, 0.1):
        near = [best + width * step / longest for step in _STEPS]
        best = max(near, key=lambda tone: explained(tone, rows))
    return best


def _clear(seen: Sequence[_Seen], tone: float) -> list[_Seen]:
    """Return the views of which `tone` is no harmonic, or only one of very high order."""
    kept = []
    for row in seen:
        view, error = row[0], row[1]
        order = tone / view.frequency if view.frequency > 0 else 0.5
        away = abs(order - round(order)) * view.frequency * error.size * view.dt
        if view.frequency <= 0 or away >= BINS or order > HIGHEST_ORDER + 0.5:
            kept.append(row)
    return kept


def with_aligned_phases(
    data: Dataset,
    errors: Sequence[FloatArray],  # [m]
    others: Sequence[FitData],
    others_errors: Sequence[FloatArray],
) -> Dataset:
    """Return `data` with start times for which the strongest tone has the same phase everywhere.

    Held-out records provide only their own phase, a number that no model can predict.
    """
    tone = find_tone(data.training, errors)
    if tone is None:
        return data
    known = {
        v.name: phasor(v, e, tone.frequency)
        for v, e in zip((*data.training, *others), (*errors, *others_errors), strict=True)
        if np.all(np.isfinite(e))
    }
    sure = {name: z for name, z in known.items() if abs(z) > TRUSTED * tone.amplitude}
    starts = {v.name: v.start for v in (*data.training, *data.held_out)}
    first = next((v.name for v in data.training if v.name in sure), None)
    if first is None:
        return data
    # phase of the tone at time 0 of the recorded clock, by the first record
    zero = np.angle(sure[first]) - 2.0 * np.pi * tone.frequency * starts[first]
    for name, z in sure.items():
        ahead = (np.angle(z) - zero) / (2.0 * np.pi) - tone.frequency * starts[name]
        starts[name] += (ahead - round(ahead)) / tone.frequency
    return data.with_each(lambda view: replace(view, start=starts[view.name]))


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
