"""A tone that is not of the drive gets one phase on the clock of all records."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.blocks.effect import Residual
from piezo_hysteresis.blocks.mains_hum import guess
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import find_tone, phasor, with_aligned_phases
from piezo_hysteresis.identification.fit_data import FitData, whole
from piezo_hysteresis.numerics.harmonics import (
    harmonics,
    line_amplitudes,
    non_harmonic_lines,
    phase_of,
    resolved_lines,
    tone_amplitude,
)
from piezo_hysteresis.records import Record, RecordInfo

DT, TONE, SIZE = 1e-3, 41.7, 3e-7


def tone(view: FitData, phase: float) -> np.ndarray:
    """Return a tone at the compared samples, its phase that at the first driven sample."""
    return SIZE * np.cos(phase_of(TONE, DT, view.measured.size, view.first) + phase)


def records() -> list[Record]:
    generator = np.random.default_rng(5)
    found = []
    for frequency in (3.0, 7.0, 11.0, 17.0, 23.0):
        voltage = np.sin(phase_of(frequency, DT, 4000))
        measured = 1e-5 * voltage + generator.normal(0.0, 1e-8, voltage.size)
        info = RecordInfo(excitation='sine', frequency=frequency, amplitude=1.0)
        found.append(Record(f'{frequency:g} Hz', DT, voltage, measured, info=info))
    return found


def test_phases_count_from_sample_0_wherever_a_fit_begins() -> None:
    phase = phase_of(TONE, DT, 500, first=123)
    np.testing.assert_array_equal(phase, phase_of(TONE, DT, 623)[123:])
    # ten whole periods, so that the mean is on no other line
    _, phasors, left = harmonics(np.cos(phase_of(25.0, DT, 400) + 0.4), 25.0, DT)
    assert np.angle(phasors[1]) == pytest.approx(0.4)
    assert left == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(('samples', 'frequency', 'first'), [(4000, 13.37, 0), (300, 4.1, 77)])
def test_a_tone_is_that_of_a_fit_by_least_squares(
    samples: int, frequency: float, first: int
) -> None:
    error = np.random.default_rng(3).standard_normal(samples) + 2.0
    phase = phase_of(frequency, 1e-3, samples, first)
    fitted = line_amplitudes(error, phase, (1,))[1][0]
    assert tone_amplitude(error, frequency, 1e-3, first) == pytest.approx(fitted, abs=1e-10)
    assert tone_amplitude(np.ones(8), 0.0, 1e-3) == 0.0


def test_a_tone_gets_one_phase_on_the_clock_of_all_records() -> None:
    data = split(records())
    errors = [tone(view, 1.3 * j) for j, view in enumerate(data.training)]
    found = find_tone(data.training, errors)
    assert found is not None
    assert found.frequency == pytest.approx(TONE, rel=1e-4)
    assert found.amplitude == pytest.approx(SIZE, rel=1e-3)

    on_the_clock = []
    aligned = with_aligned_phases(data, errors, (), ()).training
    for view, error in zip(aligned, errors, strict=True):
        phase = np.angle(phasor(view, error, found.frequency))
        on_the_clock.append(phase - 2.0 * np.pi * found.frequency * view.start)
        assert abs(view.start) < 1.0 / TONE  # moved by less than a period
    spread = np.abs(np.angle(np.exp(1j * (np.array(on_the_clock) - on_the_clock[0]))))
    assert spread.max() < 1e-6


def test_where_nothing_stands_out_no_clock_is_moved() -> None:
    data = split(records())
    generator = np.random.default_rng(6)
    noise = [generator.normal(0.0, 1e-8, v.measured.size) for v in data.training]
    assert with_aligned_phases(data, noise, (), ()) is data


@pytest.mark.parametrize('hum', [39.57, 50.0, 31.3])
def test_a_tone_is_seen_in_two_periods_of_the_drive(hum: float) -> None:
    t = DT * np.arange(int(2.25 / DT))
    noise = np.random.default_rng(2).normal(0.0, 1e-8, t.size)
    triangle = 1e-6 * np.abs((t + 0.25) % 1.0 - 0.5)
    for size in (SIZE, 0.0):
        frequency, lines = non_harmonic_lines(
            triangle + size * np.sin(phase_of(hum, DT, t.size)) + noise, DT, 1.0
        )
        clear = bool(np.max(lines) > 5.0 * 1e-8 * np.sqrt(t.size))
        assert clear == (size > 0.0)
        if size:
            assert frequency[np.argmax(lines)] == pytest.approx(hum, abs=0.25)


@pytest.mark.parametrize('hum', [50.0, 50.13, 13.0, 5.0, 0.0])
def test_a_tone_on_a_high_harmonic_of_a_slow_drive_is_seen(hum: float) -> None:
    t = DT * np.arange(8000)
    noise = np.random.default_rng(2).normal(0.0, 1e-8, t.size)
    triangle = 1e-6 * np.abs((t + 0.25) % 1.0 - 0.5)  # of 1 Hz: odd harmonics fall as a square law
    frequency, lines = non_harmonic_lines(
        triangle + SIZE * np.sin(phase_of(hum, DT, t.size)) + noise, DT, 1.0
    )
    # of the fifth harmonic nobody can tell whose it is
    expected = hum if hum > 12.0 else 0.0
    top = frequency[np.argmax(lines)]
    if expected:
        assert top == pytest.approx(expected, abs=0.13)
    else:
        assert np.max(lines) < 10.0 * np.median(lines[lines > 0.0])


def test_find_tone_in_records_of_few_periods() -> None:
    """Each line is near a harmonic, but the same line is most of every residual."""
    rng, dt = np.random.default_rng(2), 1.1e-3
    views, errors = [], []
    for place, drive in enumerate((4.113, 7.049, 1.643, 13.31)):
        times = dt * np.arange(1125)
        voltage = np.sin(2 * np.pi * drive * times)
        record = Record(f'{place}', dt, voltage, 1e-6 * voltage, info=RecordInfo(frequency=drive))
        views.append(whole(record))
        phase = rng.uniform(0.0, 2 * np.pi)
        harmonic = 5e-8 * np.sin(2 * np.pi * 3 * drive * times)
        tone = 3e-7 * np.sin(2 * np.pi * 14.57 * times + phase)
        errors.append(tone + harmonic + 5e-9 * rng.standard_normal(times.size))
    found = find_tone(views, errors)
    assert found is not None
    assert found.frequency == pytest.approx(14.57, abs=0.05)
    assert found.amplitude == pytest.approx(3e-7, rel=0.1)
    # a residual that follows its drive is no tone
    driven = [
        1e-7 * view.voltage[: e.size] + 5e-9 * rng.standard_normal(e.size)
        for view, e in zip(views, errors, strict=True)
    ]
    assert find_tone(views, driven) is None
    assert find_tone(views[:1], errors[:1]) is None


def test_the_frequency_of_a_tone_does_not_depend_on_how_many_records_show_it_clearly() -> None:
    """24.308 Hz is near a harmonic of 2 and 5 Hz; 24.2 Hz is less near one of 5 Hz."""
    rng, views, errors = np.random.default_rng(4), [], []
    times = DT * np.arange(3750)
    for place, drive in enumerate((2.0, 2.0, 5.0, 5.0, 17.0, 17.0)):
        voltage = np.sin(2 * np.pi * drive * times)
        record = Record(f'{place}', DT, voltage, 1e-6 * voltage, info=RecordInfo(frequency=drive))
        views.append(whole(record))
        line = 5e-7 * np.sin(2 * np.pi * 24.308 * times + place)
        errors.append(line + 5e-8 * rng.standard_normal(times.size))
    found = find_tone(views, errors)
    assert found is not None
    assert found.frequency == pytest.approx(24.308, abs=5e-3)
    assert found.amplitude == pytest.approx(5e-7, rel=0.02)


def test_a_tone_is_not_guessed_at_a_harmonic_of_many_periods() -> None:
    """The third harmonic of 17 Hz is most of the residual, the tone is a sixth of it."""
    times = DT * np.arange(3750)
    voltage = np.sin(2 * np.pi * 17.0 * times)
    residual = 3e-6 * np.sin(2 * np.pi * 51.0 * times) + 5e-7 * np.sin(2 * np.pi * 22.8 * times)
    found = guess(Residual(voltage, 1e-6 * voltage, residual, DT, 17.0))
    assert [each['hum_frequency'] for each in found] == pytest.approx([22.8], abs=0.05)


def test_a_slow_change_is_no_tone() -> None:
    lines = resolved_lines(1e-7 * np.exp(-np.linspace(0.0, 2.0, 1125)))
    assert np.all(lines[:3] == 0.0)
    voltage = np.sin(2 * np.pi * 4.1 * 1e-3 * np.arange(1125))
    slow = 1e-7 * np.linspace(0.0, 1.0, 1125)
    found = guess(Residual(voltage, 1e-6 * voltage, slow, 1e-3, 4.1))
    sizes = [np.hypot(each['hum_sine'], each['hum_cosine']) for each in found]
    assert all(size < 0.3 * np.ptp(slow) for size in sizes)
