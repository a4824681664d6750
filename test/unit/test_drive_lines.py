"""The basis of residuals: harmonics follow a drive, octaves are those of the drive."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.model_discrepancy import drive_lines, drive_phase, octaves_of
from piezo_hysteresis.numerics.harmonics import phase_of

DT, DRIVE, SIZE = 1e-2, 0.145, 7000


def wandering(size: float) -> FloatArray:
    """Return the phase of a drive of ten periods whose length wanders [rad]."""
    even = phase_of(DRIVE, DT, SIZE)
    return even + size * np.sin(even / 7.0)


def triangle(phase: FloatArray) -> FloatArray:
    return 15.0 + 20.0 * (2.0 / np.pi) * np.arcsin(np.cos(phase))


@pytest.mark.parametrize('wave', [np.cos, triangle], ids=['sine', 'triangle'])
def test_a_phase_that_wanders_is_followed(wave: object) -> None:
    phase = wandering(0.25)
    found = drive_phase(wave(phase), DT, DRIVE)  # type: ignore[operator]
    inside = slice(700, -700)
    assert np.abs(found - phase)[inside].max() < 0.05
    assert np.abs(found - phase).max() < 0.2


def test_a_frequency_that_is_not_quite_that_of_the_drive_is_corrected() -> None:
    phase = phase_of(1.01 * DRIVE, DT, SIZE) + 0.7
    assert drive_phase(np.cos(phase), DT, DRIVE) == pytest.approx(phase, abs=0.02)


@pytest.mark.parametrize(
    'drive',
    [
        np.cos(wandering(0.0)),
        triangle(wandering(0.0)) + np.random.default_rng(0).normal(0.0, 0.5, SIZE),
        np.random.default_rng(1).standard_normal(SIZE),
        np.zeros(SIZE),
        np.cos(wandering(0.25))[:1500],
    ],
    ids=['steady', 'noise on a triangle', 'noise', 'rest', 'two periods'],
)
def test_a_phase_that_does_not_wander_turns_at_the_frequency(drive: FloatArray) -> None:
    np.testing.assert_array_equal(drive_phase(drive, DT, DRIVE), phase_of(DRIVE, DT, drive.size))


def test_harmonics_of_a_wandering_drive_are_lines() -> None:
    """What remains between the lines is of the first and the last period."""
    phase = wandering(0.25)
    error = np.cos(9 * phase + 0.4)
    left = []
    for drive in (np.cos(phase), np.cos(phase_of(DRIVE, DT, SIZE))):
        lines = drive_lines(drive, DT, DRIVE)
        assert lines is not None
        rest = lines.split(error - error.mean())[1]
        left.append(float(rest @ rest) / float(error @ error))
    assert left[0] < 0.15
    assert left[1] > 0.5  # lines of a constant frequency


def test_octaves_do_not_depend_on_the_length_of_a_record() -> None:
    """A tone between harmonics 13 and 14 is in one octave of records of any length."""
    for drive in (DRIVE, 0.0):
        places = set()
        for count in (1700, 5200, 7058, 9999):
            octave, base = octaves_of(count, DT, drive)
            at = round(13.5 * DRIVE * count * DT) - 1
            places.add((int(octave[at]), base))
            assert octave.size == count // 2
            assert np.all(np.diff(octave) >= 0)
        assert len(places) == 1


def test_what_a_record_resolves_of_its_lowest_octave_belongs_to_the_next() -> None:
    octave, base = octaves_of(1000, 1e-3, 0.0)
    assert base == 1.0
    assert octave[:8].tolist() == [0, 1, 1, 2, 2, 2, 2, 3]
    assert octaves_of(700, 1e-3, 0.0)[0][:4].tolist() == [1, 1, 2, 2]
