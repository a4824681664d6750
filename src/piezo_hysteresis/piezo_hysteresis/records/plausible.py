"""Values of records that no piezo actuator has, or few: mostly a mistaken unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray

LARGEST_STROKE = 0.02  # largest displacement of any piezo actuator [m]
UNLIKELY_STROKE = 5e-3
SMALL_STROKE = 5e-7
SMALLEST_STROKE = 1e-10  # the distance of two atoms
LARGEST_VOLTAGE = 5e3  # largest voltage of an amplifier for piezo actuators [V]
# A bimorph behind its amplifier moves 1e-4 m per volt of the command, quartz 2e-12.
LARGEST_GAIN, SMALLEST_GAIN = 1e-2, 1e-12  # [m/V]
SLOWEST_RATE, FASTEST_RATE = 20.0, 1e6  # [Hz]
SLOWEST_DRIVE = 0.02  # a period takes longer only in studies of creep [Hz]
_FEWEST_TURNS = 4  # half periods from which a drive has a frequency
_USUAL = (5.0, 95.0)  # percentiles within which readings are no codes of a sensor

_NAME_IT = 'name it with its unit (displacement_um, _nm, _mm, _m)'


def unit_findings(
    dt: float,  # [s]
    voltages: Sequence[FloatArray],  # [V] or [N], one for each input
    displacements: Sequence[FloatArray],  # [m], one for each output
    input_unit: str,
) -> list[tuple[bool, str]]:
    """Return what indicates wrong units of a record with motion, and whether it is certain."""
    swings = [float(np.ptp(each)) for each in voltages]
    strokes = [stroke for stroke in map(_stroke_without_codes, displacements) if stroke > 0.0]
    if not strokes or max(swings) == 0.0:
        return []
    found = _stroke(max(strokes))
    if input_unit == 'V':
        most = max(float(np.max(np.abs(each))) for each in voltages)
        found += _voltage(most, max(strokes) / max(swings))
    return found + _time(dt, voltages[int(np.argmax(swings))])


def _stroke_without_codes(displacement: FloatArray) -> float:
    """Return the range of a displacement without codes of a sensor that sees no target [m]."""
    whole = float(np.ptp(displacement))
    if whole <= UNLIKELY_STROKE:
        return whole
    usual = float(np.ptp(np.percentile(displacement, _USUAL)))
    return usual if 0.0 < usual <= UNLIKELY_STROKE else whole


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


def _voltage(most: float, gain: float) -> list[tuple[bool, str]]:
    if most > LARGEST_VOLTAGE:
        text = f'the voltage reaches {most:.3g} V, which no amplifier gives'
        return [(True, f'{text}; if it is in mV, name it voltage_mV')]
    if not SMALLEST_GAIN < gain < LARGEST_GAIN:
        text = (
            f'{gain:.3g} m per volt is no gain of a piezo actuator; check the units of voltage '
            '(voltage_V, _mV, _kV) and displacement'
        )
        return [(False, text)]
    return []


def _time(dt: float, drive: FloatArray) -> list[tuple[bool, str]]:
    if not dt > 0.0:
        return []
    rate, duration = 1.0 / dt, dt * drive.size
    text = f'a rate of {rate:.3g} Hz over {duration:.3g} s; if the times are in '
    if rate > FASTEST_RATE:
        return [(False, f'{text}s, name the column time_s')]
    if rate < SLOWEST_RATE:
        return [(False, f'{text}ms, name the column time_ms')]
    if duration * SLOWEST_DRIVE < 1.0:  # no period is longer
        return []
    period = dt * _period(drive)
    if period * SLOWEST_DRIVE > 1.0:
        text = f'a period of the drive takes {period:.3g} s; if the times are in '
        return [(False, f'{text}ms, name the column time_ms')]
    return []


def _period(drive: FloatArray) -> float:
    """Return the mean period of what goes to and fro between the outer quarters [samples].

    It is 0 for fewer moves: a step or a staircase has no period.
    """
    low, high = np.min(drive), np.max(drive)
    outer = np.flatnonzero(np.abs(drive - 0.5 * (low + high)) > 0.25 * (high - low))
    turns = outer[1:][np.diff(drive[outer] > 0.5 * (low + high))]
    if turns.size < _FEWEST_TURNS:
        return 0.0
    return 2.0 * float(turns[-1] - turns[0]) / (turns.size - 1)
