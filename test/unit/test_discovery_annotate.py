"""Records that say nothing of their excitation get it from the input."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.tones import annotated, sine_frequency
from piezo_hysteresis.records import Record, RecordInfo

RATE = 1000.0
TIME = np.arange(4321) / RATE


@pytest.mark.parametrize('frequency', [0.7, 1.0, 7.0, 23.4, 149.3])
def test_a_sine_is_recognised_with_its_frequency(frequency: float) -> None:
    voltage = 0.2 + 0.9 * np.sin(2 * np.pi * frequency * TIME + 0.3)
    assert sine_frequency(voltage, 1 / RATE) == pytest.approx(frequency, rel=1e-4)


def test_what_is_no_sine_stays_unknown() -> None:
    generator = np.random.default_rng(3)
    square = np.sign(np.sin(2 * np.pi * 5 * TIME))
    assert sine_frequency(square, 1 / RATE) == 0.0
    assert sine_frequency(generator.normal(size=TIME.size), 1 / RATE) == 0.0


def test_known_metadata_are_not_changed() -> None:
    voltage = np.sin(2 * np.pi * 5 * TIME)
    info = RecordInfo(excitation='triangle', frequency=5.0)
    kept = annotated([Record('a', 1 / RATE, voltage, voltage, info=info)])[0]
    assert kept.info == info
    filled = annotated([Record('a', 1 / RATE, voltage, voltage)])[0]
    assert filled.info.excitation == 'sine'
    rest = annotated([Record('a', 1 / RATE, 0 * voltage, voltage)])[0]
    assert rest.info.excitation == 'rest'
