"""Compensation of several axes: a raster scan of an XY scanner with cross-talk."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_tracking import tracked
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.coupled.axes_chain import repeated
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.waveforms import Sine

RATE, MICRO = 2000.0, 1e-6
FAST = '1=triangle:frequency=20,amplitude=2e-6,duration=0.5'
SLOW = '2=triangle:frequency=2,amplitude=2e-6,duration=0.5'


def scanner(cross: float = 0.02, faster: float = 1.0) -> ModalModel:
    """Return a scanner of two axes, whose modes also move the other axis."""
    layout = ModalLayout(2, 2, 2, voltage_plays=(0.3, 1.0))
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * faster * np.array([310.0, 420.0]))
    found['log_damping'][:] = np.log(0.02)
    found['shape'][...] = np.eye(2)
    found['voltage_weights'][...] = 0.1
    output = np.zeros((len(layout.signal_names), 2))
    output[:2] = MICRO * np.array([[1.0, cross], [cross, 1.0]])
    return ModalModel(layout, vector, output, 3.0, 1.0 / RATE)


def reference() -> FloatArray:
    t = np.arange(1000) / RATE
    return MICRO * np.column_stack([np.sin(2 * np.pi * 20.0 * t), np.zeros(t.size)])


@pytest.mark.component
def test_the_feedforward_of_the_plant_itself_decouples_the_axes() -> None:
    alone, forward, _ = tracked(scanner(), scanner(), reference())
    assert alone.rms[1] == pytest.approx(0.02 * MICRO / np.sqrt(2.0), rel=0.1)
    assert np.all(forward.rms < 0.01 * alone.rms)


@pytest.mark.component
def test_attenuation_takes_what_the_model_of_another_scanner_leaves() -> None:
    plant = scanner(cross=0.05, faster=0.97)
    alone, forward, learnt = tracked(scanner(), plant, reference(), noise=1e-9)
    assert np.all(forward.rms < alone.rms)
    assert forward.rms[1] > 0.01 * MICRO
    assert np.all(learnt.rms < 2e-9)


def test_a_plant_of_other_axes_is_refused() -> None:
    with pytest.raises(CompensationError, match='interval of the model'):
        tracked(scanner(), replace(scanner(), dt=1e-4), reference())


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """Return the first words of the command: a model, and a plant with twice its cross-talk."""
    for name, cross in (('model', 0.02), ('plant', 0.04)):
        modal_file.save(scanner(cross), tmp_path / f'{name}.yaml')
    where = [str(tmp_path / f'{name}.yaml') for name in ('model', 'plant')]
    return ['compensate', '--model', where[0], '--plant', where[1], '--out', str(tmp_path / 'out')]


@pytest.mark.component
def test_the_command_writes_the_voltages_of_all_axes(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*files, '--reference', FAST, '--reference', SLOW]) == 0
    out = Path(files[-1])
    runs = json.loads((out / 'summary.json').read_text())['runs']
    assert [each['run'] for each in runs] == ['each axis alone', 'feedforward', 'with attenuation']
    assert max(runs[-1]['rms_m']) < 0.2 * max(runs[0]['rms_m'])
    columns = np.genfromtxt(out / 'voltage.csv', delimiter=',', names=True)
    assert columns.dtype.names == ('time_s', 'voltage_1_V', 'voltage_2_V')
    assert len(columns) == 1000
    assert (out / 'report.html').exists()
    assert 'with attenuation' in capsys.readouterr().out


@pytest.mark.component
@pytest.mark.parametrize(
    ('reference', 'sentence'),
    [
        (FAST.replace('20', '20.5'), 'axis 1: the reference jumps by'),
        (FAST + ',offset=3e-6', 'the mean of the reference, 3 µm, is left out'),
        (FAST, ''),
    ],
)
def test_what_of_a_reference_is_not_followed_is_stated(
    files: list[str], capsys: pytest.CaptureFixture[str], reference: str, sentence: str
) -> None:
    assert main([*files, '--reference', reference.replace('triangle', 'sine')]) == 0
    out = capsys.readouterr().out
    assert sentence in out
    assert sentence or 'axis 1: ' not in out


@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        (['--reference', FAST.removeprefix('1=')], 'takes --reference N=KIND'),
        (['--reference', FAST.replace('1=', '3=', 1)], 'axes are 1 to 2'),
        (['--reference', FAST, '--reference', FAST], 'each at most once'),
        (['--reference', FAST, '--reference', SLOW.replace('0.5', '1')], 'one duration for all'),
        (['--reference', FAST, '--set', 'coupled.orders=[3]'], 'give --periods'),
        (['--reference', FAST, '--together'], '--together: of one axis'),
        (['--reference', FAST, '--high', '1'], 'beyond --low and --high'),
        (['--reference', FAST, '--slew', '10'], 'more than --slew'),
        (['--reference', FAST, '--low', '5', '--high', '1'], 'must be below --high'),
        (['--reference', FAST, '--noise=-1e-9'], '--noise must be 0 or more'),
        (['--reference', FAST.replace('20', '1500')], 'cannot be sampled at 2000 Hz'),
    ],
)
def test_what_several_axes_cannot_do_is_one_sentence(
    files: list[str], capsys: pytest.CaptureFixture[str], more: list[str], sentence: str
) -> None:
    assert main([*files, *more]) == 2
    assert sentence in capsys.readouterr().err


def linear_model() -> ModalModel:
    """Return a linear model of the simulated XY scanner, as its preset describes it, at 4 kHz."""
    layout = ModalLayout(2, 2, 2)
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * np.array([620.0, 240.0]))
    found['log_damping'][:] = np.log([0.02, 0.03])
    found['shape'][...] = np.eye(2)
    output = np.zeros((len(layout.signal_names), 2))
    output[:2] = 0.2 * MICRO * np.array([[1.0, 0.02], [-0.02, 1.0]])
    return ModalModel(layout, vector, output, 20.0, 1.0 / 4000.0)


@pytest.mark.component
@pytest.mark.parametrize('lines', [20, 50])
def test_a_raster_scan_of_the_simulated_scanner_is_decoupled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: int
) -> None:
    modal_file.save(linear_model(), tmp_path / 'model.yaml')
    out = tmp_path / 'out'
    command = ['compensate', '--model', str(tmp_path / 'model.yaml'), '--out', str(out)]
    command += ['--plant', 'preset:xy_scanner', '--plant-set', 'effects.body_1=false']
    command += ['--reference', f'1=triangle:frequency={lines},amplitude=3e-6,duration=0.5']
    command += ['--reference', '2=triangle:frequency=2,amplitude=3e-6,duration=0.5']
    assert main(command) == 0
    alone, forward, learnt = json.loads((out / 'summary.json').read_text())['runs']
    parts = [[pair['part'] for pair in each['cross_talk']] for each in (alone, forward, learnt)]
    assert parts[0] == pytest.approx([0.02, 0.02], abs=0.004)
    assert max(parts[1]) < 0.005  # what hysteresis, which this model lacks, leaves
    assert max(parts[2]) < 0.003  # its noise
    assert max(learnt['rms_m']) < 0.1 * max(alone['rms_m'])
    assert '1 to 2 [%]' in capsys.readouterr().out


@pytest.mark.component
@pytest.mark.parametrize(
    ('plant', 'more', 'sentence'),
    [
        ('preset:xy_scanner', ['--noise', '1e-9'], 'its own noise'),
        ('preset:xy_scanner', ['--plant-set', 'axis_3.actuator.gain=1'], 'axis_3.actuator.gain'),
        ('preset:mirror_three_piezos', [], 'it has 3 voltages'),
        ('preset:generic_bouc_wen', [], 'it has 1 voltage,'),
        ('', ['--plant-set', 'effects.body_1=false'], 'is for a simulated plant'),
    ],
)
def test_a_simulated_plant_that_does_not_fit_is_refused(
    files: list[str],
    capsys: pytest.CaptureFixture[str],
    plant: str,
    more: list[str],
    sentence: str,
) -> None:
    if plant:
        files[files.index('--plant') + 1] = plant
    assert main([*files, '--reference', FAST, *more]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.component
def test_a_reference_beyond_the_simulated_plant_is_refused(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    files[files.index('--plant') + 1] = 'preset:xy_scanner'
    assert main([*files, '--reference', FAST.replace('2e-6', '90e-6')]) == 2
    assert 'xy_scanner takes -50 to 50 V' in capsys.readouterr().err


@pytest.mark.component
def test_the_law_of_the_nodes_follows_the_references_tick_by_tick(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*files, '--reference', FAST, '--reference', SLOW, '--periods', '3']
    assert main(words) == 2
    assert 'on a simulated plant preset:NAME' in capsys.readouterr().err
    words[4] = 'preset:xy_scanner'
    assert main([*words, '--set', 'coupled.orders=[0,1,3]']) == 0
    runs = json.loads((Path(files[-1]) / 'summary.json').read_text())['runs']
    names = ['feedforward, by ticks', 'attenuation, by ticks', 'with attenuation']
    assert [each['run'] for each in runs][-3:] == names
    forward, learnt = runs[-3]['rms_m'], runs[-2]['rms_m']
    assert learnt[0] < forward[0]


def test_a_repeated_waveform_continues_its_phase() -> None:
    time = np.arange(500) / RATE
    one = Sine(MICRO, 20.0, 0.25).sample(time)
    long = Sine(MICRO, 20.0, 1.0).sample(np.arange(1500) / RATE)
    found = repeated(one, 3)
    for name in ('value', 'velocity', 'acceleration', 'frequency', 'phase'):
        np.testing.assert_allclose(
            getattr(found, name), getattr(long, name), rtol=1e-6, atol=1e-12, err_msg=name
        )
