"""Sweeps and the command line: what is written, what is not, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.records import read_bag, read_csv
from piezo_hysteresis.waveforms import KINDS, WaveformError
from piezo_hysteresis.waveforms.spec import has_setting
from piezo_sim import Plant, PresetError, SweepError
from piezo_sim.cli import main
from piezo_sim.sweep import grid, record_names, record_seed, simulate

SINES = grid('sine', [5.0, 23.0], [0.5, 1.0], {'duration': 0.5})


def test_a_sweep_is_the_plant_run_from_rest_with_the_seed_of_the_record() -> None:
    records = simulate('fdk_pzba_00030', SINES, seed=3)
    assert [r.name for r in records] == [
        'sine_5Hz_0.5V', 'sine_23Hz_0.5V', 'sine_5Hz_1V', 'sine_23Hz_1V',
    ]  # fmt: skip
    plant = Plant.from_preset('fdk_pzba_00030', seed=record_seed(3, 3))
    last = records[3]
    np.testing.assert_array_equal(last.displacement, plant.run(last.voltage))
    assert last.info.frequency == 23.0
    assert last.info.amplitude == 1.0
    assert last.info.excitation == 'sine'
    assert last.info.warm_up == pytest.approx(0.05)


def test_a_record_does_not_depend_on_the_others() -> None:
    alone = simulate('fdk_pzba_00030', SINES[:1], seed=3)[0]
    among = simulate('fdk_pzba_00030', SINES, seed=3)[0]
    np.testing.assert_array_equal(alone.displacement, among.displacement)
    other = simulate('fdk_pzba_00030', SINES[:1], seed=4)[0]
    assert np.any(other.displacement != alone.displacement)


@pytest.mark.parametrize('kind', sorted(KINDS))
def test_every_waveform_runs_on_an_actuator_with_a_bias(kind: Any) -> None:
    settings = {'offset': 50.0} if has_setting(kind, 'offset') else {}
    record = simulate('xiao_pi_stack', [{'kind': kind, **settings}], rate=1000.0)[0]
    assert record.info.excitation == kind
    assert np.all(np.isfinite(record.displacement))
    if settings:
        # Brought to the bias before, so the record does not begin with a step of 50 V.
        assert abs(record.displacement[1] - record.displacement[0]) < 1e-6


def test_names_are_made_unique() -> None:
    specs = [{'kind': 'rest'}, {'kind': 'rest'}, {'kind': 'sine', 'name': 'rest'}]
    assert record_names(specs) == ['rest', 'rest_2', 'rest_3']


@pytest.mark.parametrize(
    ('preset', 'specs', 'error', 'reason'),
    [
        ('fdk_pzba_00030', [], SweepError, 'no records'),
        ('ghost', SINES, PresetError, 'no preset'),
        ('fdk_pzba_00030', [{'kind': 'sine', 'amplitude': 9.0}], SweepError, 'takes -5 .. 5 V'),
        ('fdk_pzba_00030', [{'kind': 'sine', 'duration': 1e-4}], SweepError, 'two samples'),
        ('fdk_pzba_00030', [{'kind': 'sine', 'tone': 1.0}], WaveformError, 'no setting'),
    ],
)
def test_an_impossible_sweep_is_refused(preset: str, specs: Any, error: Any, reason: str) -> None:
    with pytest.raises(error, match=reason):
        simulate(preset, specs)


def _cli(*words: Any) -> int:
    return main([str(word) for word in words])


def test_the_bag_of_a_sweep_holds_what_was_simulated_and_no_label(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, labels = tmp_path / 'sweep', tmp_path / 'labels.json'
    code = _cli(
        'sweep', '--preset', 'generic_bouc_wen', '--frequencies', '5,23', '--seconds', 0.4,
        '--set', 'effects.transport_delay=true', '--set', 'amplifier.delay=0.003',
        '--actuator', 'unknown', '--seed', 5, '--out', bag, '--reveal', labels,
    )  # fmt: skip
    assert code == 0
    assert '2 records, 800 samples' in capsys.readouterr().out
    overrides = {'effects.transport_delay': True, 'amplifier.delay': 0.003}
    expected = simulate(
        'generic_bouc_wen', grid('sine', [5.0, 23.0], [1.0], {'duration': 0.4}), overrides, 5
    )
    for record, wanted in zip(read_bag(bag), expected, strict=True):
        np.testing.assert_array_equal(record.displacement, wanted.displacement)
        np.testing.assert_array_equal(record.voltage, wanted.voltage)
        assert record.info.actuator == 'unknown'
    content = b''.join(file.read_bytes() for file in bag.iterdir())
    for word in (b'delay', b'effects', b'bouc_wen', b'generic', b'preset'):
        assert word not in content
    told = json.loads(labels.read_text())
    assert told['effects_beyond_the_preset'] == ['transport_delay']
    assert told['parameters']['amplifier.delay'] == 0.003
    assert told['overrides'] == overrides


def test_archives_csv_and_plans(tmp_path: Path) -> None:
    plan = tmp_path / 'plan.yaml'
    plan.write_text('- {kind: step, amplitude: 0.5, duration: 1.0, name: creep}\n- {kind: rest}\n')
    archive = tmp_path / 'sweep.npz'
    revealed = tmp_path / 'told.yaml'
    assert _cli('sweep', '--plan', plan, '--noise', 0, '--out', archive, '--reveal', revealed) == 0
    columns = np.load(archive)
    assert sorted(columns)[:3] == ['creep/displacement_m', 'creep/time_s', 'creep/voltage_V']
    assert 'noise' not in yaml.safe_load(revealed.read_text())['effects']
    single = tmp_path / 'one.csv'
    words = ('sweep', '--waveform', 'reversal_curves', '--options', 'curves=2,rate=20')
    assert _cli(*words, '--out', single) == 0
    assert read_csv(single).duration == pytest.approx(0.7, abs=0.2)


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (('--preset', 'ghost', '--out', 'x'), 'there is no preset'),
        (('--set', 'effects.ghost=true', '--out', 'x'), 'has no parameter'),
        (('--set', 'sensor.offset=7', '--out', 'x'), 'outside'),
        (('--waveform', 'ghost', '--out', 'x'), 'there is no waveform'),
        (('--waveform', 'staircase', '--seconds', '3', '--out', 'x'), 'leave out --seconds'),
        (('--frequencies', '1,2', '--out', 'x.csv'), 'one record'),
        (('--out', '.'), 'exists already'),
        (('--plan', 'missing.yaml', '--out', 'x'), 'cannot be read'),
        (('--out', 'x', '--reveal', 'x.txt'), '.json or .yaml'),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _cli('sweep', *words) == 2
    error = capsys.readouterr().err
    assert error.startswith('error: ')
    assert error.count('\n') == 1
    assert reason in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    'words',
    [
        ('--frequencies', '5:1'),
        ('--frequencies', 'x'),
        ('--set', 'a'),
        ('--set', 'a=b'),
        ('--options', 'a'),
    ],
)
def test_unreadable_options_are_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        _cli('sweep', *words, '--out', 'x')
    assert stopped.value.code == 2
    assert 'error' in capsys.readouterr().err


def test_presets_and_descriptions_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert _cli('presets') == 0
    assert 'zhou_tef' in capsys.readouterr().out
    assert _cli('describe', 'zhou_tef') == 0
    text = capsys.readouterr().out
    plant = Plant.from_preset('zhou_tef')
    assert all(row.name in text for row in plant.parameter_table)
    assert all(f'effects.{row.name}' in text for row in plant.effect_table)
    assert _cli('describe', 'waveforms') == 0
    text = capsys.readouterr().out
    assert all(kind in text for kind in KINDS)


def test_it_prints_its_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match='0'):
        main(['--version'])
    assert capsys.readouterr().out.strip() == '0.2.0'
