"""Checks of records before a discovery, without false alarms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.dataset import (
    Check,
    beyond_the_fit,
    check,
    outside_of,
    split,
    unsynchronised,
)
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import Condition, Discrepancy, ModelFile, named
from piezo_hysteresis.models.modelfile import Provenance
from piezo_hysteresis.models.schedule import OperatingRange
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.reporting.discovery_report import limits_of_records

OUTSIDE = 'The records are outside what the model was identified on:'
TIME = np.arange(3000) * 1e-3


def findings(
    voltage: Any, displacement: Any, excitation: str = 'sine', frequency: Any = 50.0
) -> tuple[str, ...]:
    info = RecordInfo(excitation=excitation, frequency=frequency)
    return check([Record('r', 1e-3, voltage, displacement, info=info)]).findings


def wave(frequency: Any) -> Any:
    return np.sin(2 * np.pi * frequency * TIME)


@pytest.mark.parametrize('frequency', [50.0, 100.0, 7.0])
def test_a_sine_that_passes_through_its_peak_is_not_clipped(frequency: float) -> None:
    finding = findings(wave(frequency), 1e-5 * wave(frequency), frequency=frequency)
    assert not any('clipped' in each for each in finding)


def test_clipping_is_reported() -> None:
    (finding,) = findings(wave(7.0), np.minimum(1e-5 * wave(7.0), 8e-6), frequency=7.0)
    assert 'the displacement lies flat at 8e-06' in finding


def test_an_inverted_sensor_is_distinguished_from_another_clock() -> None:
    (finding,) = findings(wave(7.0), -1e-5 * wave(7.0), frequency=7.0)
    assert 'runs against the voltage' in finding
    with pytest.raises(IdentificationError, match='have nothing in common'):
        findings(wave(7.0), 1e-5 * wave(31.0), frequency=7.0)


def scans(delay: float) -> list[Record]:
    """Return triangles of 2 and 20 Hz whose displacement is `delay` [s] late."""
    made = []
    for frequency in (2.0, 20.0):
        at = [np.abs((frequency * t + 0.5) % 1.0 - 0.5) for t in (TIME, TIME - delay)]
        noise = 2e-9 * np.random.default_rng(int(frequency)).standard_normal(TIME.size)
        made.append(Record(f'scan_{frequency:g}', 1e-3, 200.0 * at[0], 4e-5 * at[1] + noise))
    return made


@pytest.mark.component
def test_no_effect_is_named_where_the_displacement_runs_ahead() -> None:
    """It was a creep with a negative share and a probability of .92."""
    found = discover(scans(-0.003), 'gain', seed=1, time_limit=20.0, recommend=False).verdict
    assert (found.verdict, found.effects) == ('unknown', ())
    assert 'scan_20 runs ahead of its drive, which no actuator does' in found.summary
    assert not unsynchronised(scans(0.003)).entirely


@pytest.mark.parametrize(
    ('delays', 'ahead'),
    [
        ((-0.002, -0.002), True),
        ((0.008, 0.008), False),  # 100 Hz that is 8 ms late looks 2 ms early
        ((-0.01, -0.0005), False),  # a loop that turns the other way
        ((0.0, 0.0), False),
    ],
)
def test_one_time_at_all_frequencies_is_another_clock(
    delays: tuple[float, float], ahead: bool
) -> None:
    drives = zip((5.0, 100.0), delays, strict=True)
    given = [Record(f'sine_{f}', 1e-4, u(f, 0.0), 1e-7 * u(f, delay)) for f, delay in drives]
    assert unsynchronised(given).entirely == ahead
    assert not unsynchronised(given[1:]).entirely


def u(frequency: float, delay: float) -> np.ndarray:
    return np.asarray(50.0 * np.sin(2 * np.pi * frequency * (1e-4 * np.arange(20000) - delay)))


def test_a_report_gives_no_advice_twice() -> None:
    hold = 'record a step and hold it for 30 s'
    found = Check(('r: short',), ((('creep', 'drift'), hold), (('lag', 'creep'), hold)))
    lines = ['To distinguish creep, drift: record a step and hold it for 30 s.']
    assert limits_of_records(found, lines) == ['r: short', 'lag, creep cannot be distinguished']
    assert limits_of_records(found, []) == list(found.sentences())


def sine(name: Any, dt: Any = 1e-3, drive: Any = 1.0, **info: Any) -> Record:
    time = np.arange(2000) * dt
    shape = np.sin(2 * np.pi * 10.0 * time)
    return Record(name, dt, drive * shape, 1e-5 * shape, info=RecordInfo(**info))


UNFIT = {
    'different rates': [sine('a'), sine('b', dt=4e-4)],
    'same name': [sine('a'), sine('a')],
    'several actuators': [sine('a', actuator='x'), sine('b', actuator='y')],
    'a voltage and some a force': [sine('a'), sine('b', input_unit='N')],
    'constant in every record': [sine('a', drive=0.0)],
    'record b: the voltage is constant but the displacement moves by 20 µm': [
        sine('a'), sine('b', drive=0.0)],
}  # fmt: skip


@pytest.mark.parametrize('why', UNFIT)
def test_identify_and_discover_refuse_alike(why: Any) -> None:
    sentences = []
    for refuse in (check, lambda records: identify(records, named('classical'))):
        with pytest.raises(IdentificationError, match=why) as caught:
            refuse(UNFIT[why])
        sentences.append(str(caught.value))
    assert sentences[0] == sentences[1]


@pytest.mark.parametrize(
    ('frequency', 'scale', 'sentence'),
    [
        (10.0, 1.0, ''),
        (15.0, 1.05, ''),
        (100.0, 1.0, '100 Hz against 1 .. 10 Hz'),
        (0.2, 1.0, '0.2 Hz against 1 .. 10 Hz'),
        (10.0, 2.0, '-2 .. 2 V against -1 .. 1 V'),
        (10.0, 0.4, 'an amplitude of 0.4 V against 1 V'),
    ],
)
def test_a_changed_operating_condition_is_stated(
    frequency: float, scale: float, sentence: str
) -> None:
    model = named('classical')
    seen = tuple(Condition(f, 1.0, 1e-5, 1e-8) for f in (1.0, 10.0))
    given = ModelFile(
        model,
        model.defaults(),
        provenance=Provenance(voltage=OperatingRange(-1.0, 1.0, 1e3, 0.0)),
        discrepancy=Discrepancy(False, seen),
    )
    u = scale * np.sin(np.linspace(0.0, 20.0 * np.pi, 4001))
    record = Record('r', 1e-3, u, u, info=RecordInfo(frequency=frequency))
    found = outside_of([record], given)
    assert found.entirely is bool(sentence)
    assert found.sentence.startswith(f'{OUTSIDE} {sentence}. No effect' if sentence else '')
    assert bool(found.sentence) is bool(sentence)
    inside = replace(record, voltage=u / scale, info=RecordInfo(frequency=5.0))
    assert not outside_of([record, inside], given).entirely


@pytest.mark.parametrize(('drive', 'beyond'), [('stairs', True), ('triangle', False)])
def test_a_held_out_part_beyond_the_fitted_voltages_is_stated(drive: str, beyond: bool) -> None:
    x = np.arange(3000) / 3000.0
    u = np.floor(10.0 * x) if drive == 'stairs' else 10.0 * np.abs((4.0 * x + 1.0) % 2.0 - 1.0)
    y = 1e-6 * u + 5e-9 * np.random.default_rng(0).standard_normal(u.size)
    data = split([Record(drive, 1e-3, u, y)])
    found = beyond_the_fit(data.training, data.held_out)
    assert len(found) == beyond
    assert all('extrapolation' in sentence and '7 .. 9 V' in sentence for sentence in found)
