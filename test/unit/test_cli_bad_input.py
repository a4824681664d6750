"""What a user can get wrong: one line, exit code 2, nothing written; warnings on units."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import DataNote, IdentificationError, RecordError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.checks import require_each_usable
from piezo_hysteresis.identification.method_settings import driven_at, held_at, warmed
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, load
from piezo_hysteresis.records.plausible import unit_findings
from piezo_hysteresis.records.record import RecordInfo

HEAD = 'time_s,voltage_V,displacement_um'


def made(dt: float = 1e-3, seconds: float = 2.0, volts: float = 1.0, metres: Any = 1.0) -> Any:
    """Return time, voltage [V] and displacement [m] of a Bouc-Wen actuator."""
    model = named('classical')
    time = np.arange(round(seconds / dt)) * dt
    voltage = np.sin(2 * np.pi * 5 * time)
    moved = model.respond(voltage, model.pack({}), dt)
    moved = moved + 1e-8 * np.random.default_rng(1).standard_normal(time.size)
    return time, volts * voltage, metres * moved


def write(path: Path, time: Any, voltage: Any, micrometres: Any, head: Any = HEAD) -> Path:
    rows = np.column_stack([time, voltage, micrometres])
    np.savetxt(path, rows, '%.10g', ',', header=head, comments='')
    return path


@pytest.fixture(scope='module')
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the words that name a record, and those that name a model and a plant."""
    folder = tmp_path_factory.mktemp('files')
    time, voltage, moved = made()
    write(folder / 'base.csv', time, voltage, 1e6 * moved)
    model = named('classical')
    ModelFile(model, model.defaults()).save(folder / 'model.yaml')
    return folder


WORDS = {
    'identify': lambda f: ['identify', str(f / 'base.csv'), '--model', 'classical'],
    'rls': lambda f: ['identify', str(f / 'base.csv'), '--model', 'enhanced3', '--method', 'rls'],
    'validate': lambda f: ['validate', str(f / 'base.csv'), '--model', str(f / 'model.yaml')],
    'discover': lambda f: ['discover', str(f / 'base.csv'), '--baseline', 'classical'],
    'compensate': lambda f: [
        'compensate', '--model', str(f / 'model.yaml'), '--plant', str(f / 'model.yaml'),
        '--set', 'attenuation.enabled=false',
    ],
}  # fmt: skip
SINE = '--reference sine:frequency=5,amplitude=2e-5,duration=1'

BAD = [
    ('identify', '--method pso --max-evaluations 0', 'at least 1 evaluation, got 0'),
    ('identify', '--method de --max-evaluations -5', 'at least 1 evaluation, got -5'),
    ('identify', '--set beta=-5', 'beta = -5 1/V is impossible to start from'),
    ('identify', '--set beta=x', 'should be NAME=VALUE'),
    ('identify', '--set A1=nan', 'A1 = nan is not a number to start from'),
    ('identify', '--set A1=1e-4 A1=2e-4', 'A1 is given twice'),
    ('identify', '--set foo=1', 'no parameter foo to start from; it has A1'),
    ('identify', '--hold A1=nan', 'A1 = nan is not a number to hold'),
    ('identify', '--hold beta=-5', 'beta = -5 1/V is impossible to hold'),
    ('identify', '--hold foo=1', 'no parameter foo to hold'),
    ('identify', '--hold A1=1e-4 --set A1=2e-4', 'A1 is held at 0.0001'),
    ('identify', '--set A0=1e-5', 'A0 is held at 0'),
    ('identify', '--method pso --seed -1', 'seed must be 0 or more'),
    ('identify', '--workers -2', '--workers must be 0'),
    ('identify', '--method rls_ud --forgetting 0', 'forgetting must be above 0'),
    ('identify', '--method rls_ud --forgetting nan', 'forgetting must be above 0'),
    ('identify', '--warm-up -1', 'warm-up must be 0 s or more'),
    ('identify', '--warm-up nan', 'warm-up must be 0 s or more'),
    ('identify', '--warm-up 100', 'leaves too little of record base'),
    ('identify', '--frequency -5', 'a drive of -5 Hz'),
    ('identify', '--frequency 500', 'a drive of 500 Hz'),
    ('rls', '', 'does not say the frequency of its drive.*give --frequency'),
    ('validate', '--warm-up nan', 'warm-up must be 0 s or more'),
    ('validate', '--warm-up 50', 'leaves too little'),
    ('discover', '--warm-up -1', 'warm-up must be 0 s or more'),
    ('discover', '--seed -1', 'seed must be 0 or more'),
    ('discover', '--workers -2', '--workers must be 0'),
    ('discover', '--time-limit -1', '--time-limit must be 0'),
    ('discover', '--time-limit nan', '--time-limit must be 0'),
    ('compensate', '--reference sine:frequency=5,amplitude=120,duration=1', 'amplitudes are in m'),
    ('compensate', '--reference sine:frequency=5,amplitude=1e-5,offset=1e-3', 'reaches'),
    ('compensate', '--reference sine:frequency=900,amplitude=1e-5,duration=1', 'be sampled at'),
    ('compensate', f'{SINE} --seed -1', 'seed must be a number of 0 or more'),
    ('compensate', f'{SINE} --noise nan', 'noise must be a number of 0 or more'),
    ('compensate', f'{SINE} --noise -1', 'noise must be a number of 0 or more'),
    ('compensate', f'{SINE} --from-seconds nan', 'from_seconds must be a number of 0 or more'),
    ('compensate', f'{SINE} --set attenuation.resonance=-3', 'resonance = -3 Hz is outside'),
    ('compensate', f'{SINE} --rate 0', 'rate must be positive'),
    ('compensate', f'{SINE} --low nan', 'limits nan .. 1.2 V are not finite'),
    ('compensate', f'{SINE} --low 2 --high 1', 'limits are empty'),
    ('compensate', f'{SINE} --slew nan', 'slew limit must be positive'),
    ('compensate', f'{SINE} --slew inf', 'slew limit must be positive and finite'),
]  # fmt: skip


@pytest.mark.parametrize(('verb', 'words', 'says'), BAD, ids=lambda x: str(x)[:40])
def test_a_mistake_gets_one_line_and_leaves_nothing(
    verb: Any,
    words: Any,
    says: Any,
    files: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([*WORDS[verb](files), *words.split(), '--out', str(tmp_path / 'out')]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith('error: ')
    assert re.search(says, lines[0])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('place', ['data', 'model', 'out'])
def test_a_path_that_is_too_long_is_reported_once(
    place: str, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long = 'x' * 300
    data, model, out = files / 'base.csv', files / 'model.yaml', tmp_path / 'out'
    if place == 'data':
        data = files / f'{long}.csv'
    elif place == 'model':
        model = files / f'{long}.yaml'
    else:
        out = tmp_path / long
    assert main(['validate', str(data), '--model', str(model), '--out', str(out)]) == 2
    printed = capsys.readouterr().err
    assert printed.count(long) == 1
    assert 'the name is too long' in printed


@pytest.mark.component
def test_the_frequency_that_the_data_lack_can_be_given(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([*WORDS['rls'](files), '--frequency', '5', '--out', str(tmp_path / 'out')])
    assert 'does not say the frequency' not in capsys.readouterr().err


@pytest.mark.component
def test_a_value_of_the_file_gives_way_to_one_that_is_held(files: Path, tmp_path: Path) -> None:
    words = ['identify', str(files / 'base.csv'), '--model', str(files / 'model.yaml')]
    out = tmp_path / 'out'
    assert main([*words, '--hold', 'beta=0.5', '--out', str(out)]) == 0
    assert ModelFile.load(out / 'model.yaml').values['beta'] == 0.5


def test_python_has_the_same_messages(files: Path) -> None:
    records = load([files / 'base.csv'])
    for options, says in (
        ({'start': {'beta': -5.0}}, 'impossible to start from'),
        ({'workers': 0}, 'workers'),
        ({'method': 'de', 'max_evaluations': 0}, 'budget'),
    ):
        with pytest.raises(IdentificationError, match=says):
            identify(records, named('classical'), **options)
    with pytest.raises(RecordError, match='warm-up must be'):
        replace(records[0], info=RecordInfo(warm_up=-1.0))


# --- units --------------------------------------------------------------------------------------


def record(dt: float = 1e-3, volts: float = 1.0, metres: float = 1.0, unit: str = 'V') -> Record:
    _, voltage, moved = made(volts=volts, metres=metres)
    return Record('mine', dt, voltage, moved, info=RecordInfo(input_unit=unit))


@pytest.mark.parametrize(
    ('changed', 'says'),
    [
        ({'metres': 1e-3}, 'in m or mm'),
        ({'metres': 1e-6 * 20}, 'in m or mm'),
        ({'metres': 50.0}, 'more than most'),
        ({'volts': 1e-3}, 'no gain of a piezo actuator'),
        ({'dt': 1.0}, 'name the column time_ms'),
        ({'dt': 1e-7}, 'name the column time_s'),
    ],
)
def test_what_is_off_by_a_thousand_is_doubted(changed: dict[str, Any], says: str) -> None:
    problems = require_each_usable([record(**changed)])
    assert len(problems) == 1
    assert problems[0].startswith('record mine: ')
    assert says in problems[0]


@pytest.mark.parametrize(
    ('changed', 'says'),
    [
        ({'metres': 1e-7}, 'less than an atom'),
        ({'metres': 1e3}, 'no piezo act'),
        ({'volts': 1e4}, 'name it voltage_mV'),
    ],
)
def test_what_no_actuator_does_is_refused(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(IdentificationError, match=says):
        require_each_usable([record(**changed)])


def test_usual_actuators_are_not_doubted() -> None:
    """A bimorph behind its amplifier, a stack, a nanometre stage, a force."""
    for usual in (
        record(),
        record(volts=150.0, metres=0.1),
        record(dt=1e-5, volts=10.0, metres=0.01),
        record(volts=1e-6, unit='N'),
        record(dt=0.05),
    ):
        given = [usual.voltage], [usual.displacement], usual.info.input_unit
        assert unit_findings(usual.dt, *given) == []


def test_a_drive_of_a_minute_per_period_is_doubted_at_any_rate() -> None:
    """Times in ms under `time_s`, of a record of 50 kHz: 50 Hz alone is a usual rate."""
    drive = np.sin(2 * np.pi * 10 * np.arange(20_000) / 50e3)
    ((certain, sentence),) = unit_findings(1e3 / 50e3, [drive], [1e-5 * drive], 'V')
    assert not certain
    assert sentence == (
        'a period of the drive takes 100 s; if the times are in ms, name the column time_ms'
    )
    assert unit_findings(1 / 50e3, [drive], [1e-5 * drive], 'V') == []


@pytest.mark.parametrize(
    ('times', 'scale', 'code', 'says'),
    [
        (1e3, 1.0, 0, 'note: {}: record mine: a rate of 1 Hz over 2e+03 s; if the times'),
        (1.0, 2e3, 0, 'm, more than most piezo actuators do; name it'),
        (1.0, 2e4, 2, 'm, which no piezo actuator does; name it'),
    ],
)
def test_the_list_of_records_names_units_that_may_be_wrong(
    times: float, scale: float, code: int, says: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    time, voltage, moved = made()
    micrometres = 4.0 * scale * moved / np.ptp(moved)
    data = write(tmp_path / 'mine.csv', times * time, voltage, micrometres)
    assert main(['info', str(data)]) == code
    assert says.format(data) in capsys.readouterr().out
    two = np.column_stack([voltage, voltage[::-1]]), 1e-6 * np.column_stack([micrometres] * 2)
    read = partial(load_axes, two, dt=times * 1e-3)
    if code:
        with pytest.raises(RecordError, match='which no piezo actuator does') as raised:
            read()
        assert '--salvage' not in str(raised.value)
    else:
        with pytest.warns(DataNote, match=re.escape(says.rpartition(': ')[2])):
            read()


@pytest.mark.component
def test_every_verb_that_reads_records_warns_of_implausible_ones(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time, voltage, moved = made()
    data = write(tmp_path / 'slow.csv', 1e3 * time, voltage, 1e6 * moved)
    for words in (
        ['identify', str(data), '--model', 'classical'],
        ['validate', str(data), '--model', str(files / 'model.yaml')],
        ['discover', str(data), '--baseline', 'classical'],
    ):
        assert main([*words, '--out', str(tmp_path / words[0])]) == 0
        assert 'name the column time_ms' in capsys.readouterr().err


# --- settings -----------------------------------------------------------------------------------


def test_values_that_agree_with_what_is_held_pass() -> None:
    model = named('classical')
    assert held_at(model, {'A1': 1e-4}, {'A1': 1e-4, 'A0': 0.0}).held['A1'] == 1e-4


def test_a_frequency_goes_to_the_records_that_lack_one() -> None:
    first, second = record(), replace(record(), info=RecordInfo(frequency=7.0))
    assert [r.info.frequency for r in driven_at([first, second], 5.0)] == [5.0, 7.0]
    assert driven_at([first, second], None) == [first, second]
    assert [r.info.warm_up for r in warmed([first, second], 0.5)] == [0.5, 0.5]
