"""Detection of wrong units: values that no piezo actuator reaches."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.identification.noise import stroke_of
from piezo_hysteresis.records import Record

LARGEST_STROKE = 0.02  # largest displacement of any piezo actuator [m]
UNLIKELY_STROKE = 5e-3
SMALL_STROKE = 5e-7
SMALLEST_STROKE = 1e-10  # the distance of two atoms
LARGEST_VOLTAGE = 5e3  # largest voltage of an amplifier for piezo actuators [V]
# A bimorph behind its amplifier moves 1e-4 m per volt of the command, quartz 2e-12.
LARGEST_GAIN, SMALLEST_GAIN = 1e-2, 1e-12  # [m/V]
SLOWEST_RATE, FASTEST_RATE = 20.0, 1e6  # [Hz]

_NAME_IT = 'name it with its unit (displacement_um, _nm, _mm, _m)'


def unit_findings(record: Record) -> list[tuple[bool, str]]:
    """Return indications that a record with motion has wrong units."""
    stroke, swing = stroke_of(record), float(np.ptp(record.voltage))
    if stroke == 0.0 or swing == 0.0:
        return []
    found = _stroke(stroke)
    if record.info.input_unit == 'V':
        found += _voltage(record, stroke / swing)
    return found + _rate(record)


def _stroke(stroke: float) -> list[tuple[bool, str]]:
    text = f'the displacement spans {stroke:.3g} m, '
    if stroke > LARGEST_STROKE:
        return [(True, f'{text}which no piezo actuator does; {_NAME_IT}')]
    if stroke < SMALLEST_STROKE:
        return [(True, f'{text}less than an atom; {_NAME_IT}')]
    if stroke > UNLIKELY_STROKE:
        return [(False, f'{text}more than most piezo actuators do; {_NAME_IT}')]
    if stroke < SMALL_STROKE:
        return [(False, f'{text}little for a piezo actuator; if it is in m or mm, {_NAME_IT}')]
    return []


def _voltage(record: Record, gain: float) -> list[tuple[bool, str]]:
    most = float(np.max(np.abs(record.voltage)))
    if most > LARGEST_VOLTAGE:
        return [(False, f'the voltage reaches {most:.3g} V; if it is in mV, name it voltage_mV')]
    if not SMALLEST_GAIN < gain < LARGEST_GAIN:
        text = (
            f'{gain:.3g} m per volt is no gain of a piezo actuator; check the units of voltage '
            '(voltage_V, _mV, _kV) and displacement'
        )
        return [(False, text)]
    return []


def _rate(record: Record) -> list[tuple[bool, str]]:
    text = (
        f'{record.rate:.3g} samples per second over {record.duration:.3g} s; if the times are in '
    )
    if record.rate < SLOWEST_RATE:
        return [(False, f'{text}ms, name the column time_ms')]
    if record.rate > FASTEST_RATE:
        return [(False, f'{text}s, name the column time_s')]
    return []
