"""Checks of records before a fit, with a recommendation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import irfft, next_fast_len, rfft

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.noise import measured_without_outliers, stroke_of
from piezo_hysteresis.identification.outliers import runs_of
from piezo_hysteresis.identification.periods import cached_per_record, main_frequency
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.plausible import unit_findings

# Samples per period below which the shape of a loop is not seen, and below which its size is not.
_SAMPLES_PER_PERIOD, _FEWEST_PER_PERIOD = 10, 4
_OPPOSED = -0.5  # correlation below which displacement and input have opposite signs
_COMMON = 0.3  # correlation or coherence from which displacement and input belong together
_REST = 0.2  # of the stroke: creep and drift at a constant input stay below it


def require_consistent(records: Sequence[Record]) -> None:
    """Refuse records that no method can use together."""
    if not records:
        raise IdentificationError('there is no record; give at least one bag or CSV file')
    names = [r.name for r in records]
    if len(set(names)) < len(names):
        raise IdentificationError('two records have the same name; give every record its own')
    rates = sorted({round(r.rate, 6) for r in records})
    if rates[-1] - rates[0] > 1e-6 * rates[-1]:
        raise IdentificationError(
            f'the records have different rates ({", ".join(f"{r:g} Hz" for r in rates)}); '
            'give those of one rate at a time, or bring them to one with `import --resample`'
        )
    if len({r.info.input_unit for r in records}) > 1:
        raise IdentificationError(
            'some records have a voltage and some a force as their input; give those of one kind'
        )
    actuators = sorted({r.info.actuator for r in records if r.info.actuator})
    if len(actuators) > 1:
        raise IdentificationError(
            f'the records are of several actuators ({", ".join(actuators)}); give those of one'
        )
    _require_motion(records)


def _require_motion(records: Sequence[Record]) -> None:
    kind = records[0].info.input_name
    driven = [r for r in records if float(np.ptp(r.voltage)) > 0]
    if not driven:
        raise IdentificationError(
            f'the {kind} is constant in every record; record a sine over the range you will use'
        )
    stroke = max(stroke_of(r) for r in driven)
    if stroke == 0.0:
        raise IdentificationError(
            'the displacement is constant; check sensor and cable, then record again'
        )
    for record in records:
        moved = stroke_of(record)
        if float(np.ptp(record.voltage)) == 0.0 and moved > _REST * stroke:
            raise IdentificationError(
                f'record {record.name}: the {kind} is constant but the displacement moves by '
                f'{1e6 * moved:.3g} µm; check that the {kind} was recorded, or leave it out'
            )


def require_usable(records: Sequence[Record]) -> list[str]:
    """Return the warnings about records to fit together, or refuse them."""
    require_consistent(records)
    return require_each_usable(records)


def require_each_usable(records: Sequence[Record]) -> list[str]:
    """Return the warnings about records, or refuse them: the same judgement for every verb."""
    remarks = []
    for record in records:
        for fatal, sentence in _judge(record):
            remarks.append(f'record {record.name}: {sentence}')
            if fatal:
                raise IdentificationError(remarks[-1])
    return remarks


def _fatal(sentence: str) -> list[tuple[bool, str]]:
    return [(True, sentence)]


def _uncertain(sentence: str) -> list[tuple[bool, str]]:
    return [(False, sentence)]


def _judge(record: Record) -> list[tuple[bool, str]]:
    u, y = record.voltage, measured_without_outliers(record)
    kind = record.info.input_name
    if len(record) < 20:
        return _fatal(f'only {counted(len(record), "sample")}; record more of the excitation')
    if float(np.ptp(u)) == 0.0:
        return []
    if float(np.ptp(y)) == 0.0:
        return _fatal('the displacement is constant; check sensor and cable, then record again')
    return [
        *unit_findings(record.dt, [u], [y], record.info.input_unit),
        *_clipping(y, 'displacement', 'sensor range'),
        *_clipping(u, kind, 'output range of the generator'),
        *_coverage(record),
        *_synchrony(record, kind),
    ]


def _clipping(x: FloatArray, what: str, cause: str) -> list[tuple[bool, str]]:
    """Warn if the signal is repeatedly constant at its extreme for several samples."""
    changing = np.diff(x) != 0
    if not np.any(changing):
        return []
    for extreme in (float(x.max()), float(x.min())):
        long = [end - begin for begin, end in runs_of(x == extreme) if end - begin >= 5]
        # a waveform made of holds (staircase, square) rests at other levels too
        resting = float(np.mean(~changing))
        share = sum(long) / x.size
        if len(long) >= 2 and share > 0.02 and resting < 3 * share:
            return _uncertain(
                f'the {what} lies flat at {extreme:.4g} in {len(long)} places: clipped at the '
                f'{cause}; lower the amplitude'
            )
    return []


def _coverage(record: Record) -> list[tuple[bool, str]]:
    frequency = record.info.frequency or main_frequency(record)
    if frequency <= 0:
        return []
    per_period = record.rate / frequency
    if per_period < _SAMPLES_PER_PERIOD:
        few = f'{per_period:.1f} samples per period of {frequency:.4g} Hz'
        better = f'sample at {20 * frequency:.4g} Hz or more'
        if per_period < _FEWEST_PER_PERIOD:
            return _fatal(f'{few} are too few; {better}')
        return _uncertain(f'{few} show few harmonics; {better} for the shape of the loop')
    return []


def _synchrony(record: Record, kind: str) -> list[tuple[bool, str]]:
    u = record.voltage - record.voltage.mean()
    measured = measured_without_outliers(record)
    y = measured - measured.mean()
    strength, even = _likeness(u, y), _likeness(u**2 - np.mean(u**2), y)
    if strength < _COMMON:
        strength = max(strength, _coherence(u, y))
    if max(strength, even) < _COMMON:
        return _fatal(
            f'displacement and {kind} have nothing in common (correlation {strength:.2f}, with '
            f'the square of the {kind} {even:.2f}); record both with one clock and check the '
            'channels'
        )
    if even > strength + 0.01:  # of two levels the square is a straight line
        sentence = (
            f'the displacement rises towards both ends of the {kind} (correlation '
            f'{strength:.2f}, with the square of the {kind} {even:.2f}): a butterfly, driven '
            'beyond the coercive voltage, or electrostriction. No model here describes it; '
            f'record with a {kind} of one sign'
        )
        return [(strength < _COMMON, sentence)]
    if float(u @ y) < _OPPOSED * float(np.linalg.norm(u) * np.linalg.norm(y)):
        return _uncertain(f'the displacement runs against the {kind}; check the polarity')
    early = time_ahead(record)
    if early > 0.0:
        return _uncertain(
            f'the displacement runs {1e3 * early:.3g} ms ahead of the {kind}: the channels '
            'are not synchronised; record both with one clock'
        )
    return []


def _likeness(x: FloatArray, y: FloatArray) -> float:
    """Return the largest correlation of two signals without mean over all lags, 0 to 1."""
    size = next_fast_len(2 * x.size - 1, real=True)
    both = irfft(rfft(y, size) * np.conj(rfft(x, size)), size)
    return float(np.max(np.abs(both))) / max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-300)


def _coherence(u: FloatArray, y: FloatArray) -> float:
    """Return the share of the power of `y` that follows `u` linearly, by Welch's method.

    A resonance delays each frequency differently, so that the signals correlate at no delay.
    """
    length = max(u.size // 16, 8)
    segments = [sliding_window_view(x, length)[:: length // 2] for x in (u, y)]
    window = np.hanning(length)
    a, b = (np.fft.rfft(window * (x - x.mean(axis=1, keepdims=True))) for x in segments)
    cross, power = np.sum(b * np.conj(a), axis=0), np.sum(np.abs(a) ** 2, axis=0)
    shared = np.abs(cross[power > 0.0]) ** 2 / power[power > 0.0]
    return float(np.sum(shared) / max(float(np.sum(np.abs(b) ** 2)), 1e-300))


@cached_per_record
def phase_ahead(record: Record) -> tuple[float, float]:
    """Return the main frequency [Hz] and the phase by which the displacement leads there [rad].

    Both are 0 without a main frequency.
    """
    frequency = main_frequency(record)
    if not frequency > 0.0:
        return 0.0, 0.0
    wave = np.exp(-2j * np.pi * frequency * record.time) * np.hanning(len(record))
    u, y = record.voltage, measured_without_outliers(record)
    lead = float(np.angle(np.sum((y - y.mean()) * wave) / np.sum((u - u.mean()) * wave)))
    # an actuator of inverted polarity has the opposite sign
    if abs(lead) > np.pi / 2:
        lead -= np.sign(lead) * np.pi
    return frequency, lead


def time_ahead(record: Record) -> float:
    """Return by how long the displacement runs ahead of its drive [s].

    0 below two hundredths of a radian or 1.5 samples.
    """
    frequency, lead = phase_ahead(record)
    if not lead > 0.02:
        return 0.0
    seconds = lead / (2.0 * np.pi * frequency)
    return seconds if seconds > 1.5 * record.dt else 0.0
