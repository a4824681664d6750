"""A second channel tells a curve of the sensor from one of the actuator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.second_channel import CURVES, RIVALS, sensor_curve
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import EFFECT_NAMES, ModelFile, named
from piezo_hysteresis.records import Record, load
from piezo_hysteresis.records.columns import second_column

DT, SAMPLES, NOISE = 1e-3, 2000, 1e-3
MODEL = named('classical')
VALUES = {**MODEL.defaults(), 'A1': 3e-7, 'A': 1e-7, 'beta': 0.02, 'gamma': 0.005}
#: Bend of the second channel of an actuator whose charge is no straight line of its stroke.
CHARGE = 0.02


def week(sensor: float, actuator: float, seed: int, charge: float = 0.0) -> list[Record]:
    """Return records of one amplitude, with curves relative to the stroke."""
    noise = np.random.default_rng(seed)
    t = DT * np.arange(SAMPLES)
    found = []
    for frequency in (1.0, 3.0):
        u = 50.0 * np.sin(2.0 * np.pi * frequency * t)
        x = MODEL.respond(u, MODEL.pack(VALUES), DT)
        stroke = float(np.ptp(x))
        x = x + actuator * x * np.abs(x) / stroke
        y = x + sensor * x * np.abs(x) / stroke
        second = x / stroke + charge * (x / stroke) ** 2
        found.append(
            Record(
                f'{frequency:g} Hz of {seed}',
                DT,
                u,
                y + NOISE * stroke * noise.standard_normal(SAMPLES),
                second=7.0 * second + NOISE * noise.standard_normal(SAMPLES),
            )
        )
    return found


@pytest.mark.parametrize('size', [0.02, -0.05])
def test_a_curve_of_the_sensor_bends_one_channel_only(size: float) -> None:
    sensor, actuator = (sensor_curve(week(*sides, 1)) for sides in ((size, 0.0), (0.0, size)))
    assert sensor is not None
    assert actuator is not None
    assert sensor.seen
    assert not actuator.seen
    # of z abs(z) over a sine, a fifth is no gain: 0.2 of size x stroke / 4 x sqrt(3 / 8)
    stroke = float(np.ptp(week(0.0, 0.0, 1)[0].displacement))
    assert sensor.rms == pytest.approx(0.2 * abs(size) * stroke / 4.0 * 0.612, rel=0.3)
    assert actuator.rms + 2.0 * actuator.std < 0.2 * sensor.rms
    assert 'of the displacement has a curve' in sensor.sentence()
    assert 'bent by less than' in actuator.sentence()


def test_a_charge_that_is_no_straight_line_is_known_from_a_reference() -> None:
    bent = sensor_curve(week(0.0, 0.0, 1, CHARGE))
    assert bent is not None
    assert bent.seen  # alone it is taken for a straight line
    known = sensor_curve(week(0.0, 0.0, 1, CHARGE), week(0.0, 0.0, 2, CHARGE))
    assert known is not None
    assert known.known
    assert not known.seen


def test_records_without_a_second_channel_show_nothing_of_the_sensor() -> None:
    (record, *_) = week(0.0, 0.0, 1)
    bare = Record('bare', DT, record.voltage, record.displacement)
    still = Record('still', DT, record.voltage, record.displacement, second=np.ones(SAMPLES))
    assert sensor_curve([bare, still]) is None


def test_what_a_second_channel_excludes() -> None:
    bent, straight = (sensor_curve(week(*sides, 3)) for sides in ((0.05, 0.0), (0.0, 0.05)))
    assert bent is not None
    assert straight is not None
    (curve,) = CURVES
    assert not CURVES & RIVALS
    assert set(EFFECT_NAMES) > CURVES | RIVALS - {'parameter_shift'}
    gap = 5.0 * bent.rms
    for rival in RIVALS:
        assert bent.excludes(rival, (), gap)
        assert not bent.excludes(rival, [curve], gap)
        assert not straight.excludes(rival, (), gap)
    assert straight.excludes(curve, (), gap)
    assert not bent.excludes(curve, (), gap)
    assert not bent.excludes('creep', (), gap)
    # its evidence is that of the second channel, which no fit has used
    assert bent.chance(curve) < 1e-9
    assert straight.chance(curve) > 0.05
    assert bent.chance('creep') == 1.0
    # a bend larger than the gap was there before, a small one is not the cause of a large gap
    assert not bent.excludes('stiffness', (), 0.5 * bent.rms)
    assert not bent.excludes('stiffness', (), 50.0 * bent.rms)


@pytest.mark.component
def test_with_a_second_channel_one_amplitude_names_the_side() -> None:
    known = ModelFile.parse(identify(week(0.0, 0.0, 1), 'classical').model.text())
    sensor, actuator = (discover(week(*c, 2), known) for c in ((0.04, 0.0), (0.0, 0.04)))
    (first, *_) = sensor.verdict.effects
    assert first.effect_class == tuple(CURVES)
    assert not CURVES & {n for e in actuator.verdict.effects for n in e.effect_class}
    assert any('second channel' in finding for finding in sensor.check.findings)


@pytest.mark.parametrize(
    ('column', 'factor'), [('charge_uC', 1e-6), ('second_um', 1e-6), ('second_V', 1.0)]
)
def test_a_named_column_is_the_second_channel(tmp_path: Path, column: str, factor: float) -> None:
    path = tmp_path / 'record.csv'
    rows = np.column_stack([np.arange(50) * DT, np.arange(50.0), np.arange(50.0), np.arange(50.0)])
    path.write_text(
        f'time_s,voltage_V,displacement_um,{column}\n'
        + '\n'.join(','.join(map(str, row)) for row in rows)
    )
    (record,) = load([path])
    assert record.second is not None
    assert record.second == pytest.approx(factor * np.arange(50.0))
    part = record.section(10, 20)
    assert part.second is not None
    assert part.second == pytest.approx(factor * np.arange(10.0, 20.0))
    slow = record.resample(500.0)
    assert slow.second is not None
    assert slow.second.size == len(slow) == 25


def test_a_current_is_summed_to_a_charge(tmp_path: Path) -> None:
    path = tmp_path / 'record.csv'
    path.write_text(
        't (s),U (V),x (um),I (mA)\n' + '\n'.join(f'{k * DT},{k},{k},1' for k in range(40))
    )
    assert load([path])[0].second is None  # it is not named for it
    assert second_column('I (mA)') == {'current': 'I (mA)'}
    assert second_column('x2:nm') == {'second': 'x2:nm'}
    assert second_column('Q [nC]') == {'charge': 'Q [nC]'}
    assert second_column('monitor') == {'second': 'monitor'}
    (record,) = load([path], columns=second_column('I (mA)'))
    assert record.second is not None
    assert record.second == pytest.approx(1e-3 * np.arange(1.0, 41.0))


def test_a_second_channel_of_another_length_is_refused() -> None:
    with pytest.raises(RecordError, match='second has 4 samples but voltage has 5'):
        Record('r', DT, np.zeros(5), np.zeros(5), second=np.zeros(4))


def test_a_bag_that_holds_no_second_channel_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'record.csv'
    path.write_text(
        'time_s,voltage_V,displacement_um,charge_uC\n'
        + '\n'.join(f'{k * DT},{k},{k},{k}' for k in range(40))
    )
    assert main(['import', str(path), '--out', str(tmp_path / 'bag')]) == 0
    assert 'a bag has no second channel' in capsys.readouterr().err
