"""What is said of records before a discovery: true alarms only."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.discovery.data.check import Check, check
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.reporting.discovery_report import untold_limits

TIME = np.arange(3000) * 1e-3


def findings(voltage, displacement, excitation='sine', frequency=50.0):
    info = RecordInfo(excitation=excitation, frequency=frequency)
    return check([Record('r', 1e-3, voltage, displacement, info=info)]).findings


def wave(frequency):
    return np.sin(2 * np.pi * frequency * TIME)


@pytest.mark.parametrize('frequency', [50.0, 100.0, 7.0])
def test_a_sine_that_passes_through_its_peak_is_not_clipped(frequency):
    finding = findings(wave(frequency), 1e-5 * wave(frequency), frequency=frequency)
    assert not any('clipped' in each for each in finding)


def test_what_is_clipped_is_said():
    (finding,) = findings(wave(7.0), np.minimum(1e-5 * wave(7.0), 8e-6), frequency=7.0)
    assert 'displacement rests at its largest' in finding


def test_an_inverted_sensor_is_told_from_one_of_another_clock():
    (finding,) = findings(wave(7.0), -1e-5 * wave(7.0), frequency=7.0)
    assert 'runs against the input' in finding
    (finding,) = findings(wave(7.0), 1e-5 * wave(31.0), frequency=7.0)
    assert 'hardly move together' in finding


def test_a_report_gives_no_advice_twice():
    hold = 'record a step and hold it for 30 s'
    found = Check(('r: short',), ((('creep', 'drift'), hold), (('lag', 'creep'), hold)))
    lines = ['To tell creep, drift apart: record a step and hold it for 30 s.']
    assert untold_limits(found, lines) == ['r: short', 'lag, creep cannot be told apart']
    assert untold_limits(found, []) == list(found.sentences())
