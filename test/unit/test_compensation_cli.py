"""The verb ``compensate``: numbers that can be believed, or one sentence and nothing written."""

import json

import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.named import named
from piezo_hysteresis.reporting.folder import MARKER

VALUES = {'A1': 150e-6, 'A': 40e-6, 'A0': 0.0, 'beta': 1.0, 'gamma': 0.1, 'offset': 6e-6,
          'natural_frequency': 68.0, 'damping_ratio': 0.015}  # fmt: skip
REFERENCE = 'sine:frequency=23,amplitude=1e-4,duration=10,ramp=1'


@pytest.fixture
def files(tmp_path):
    model, plant = tmp_path / 'model.yaml', tmp_path / 'plant.yaml'
    ModelFile(named('bouc_wen_mode'), VALUES).save(model)
    ModelFile(named('bouc_wen_mode'), {**VALUES, 'A': 44e-6, 'natural_frequency': 68.5}).save(
        plant
    )
    return ['--model', str(model), '--plant', str(plant)]


def test_study_reports_each_run_and_what_every_link_gains(files, tmp_path, capsys):
    out = tmp_path / 'out'
    words = ['compensate', *files, '--reference', REFERENCE, '--out', str(out)]
    assert main([*words, '--orders', '0', '1', '3', '--pid', '0', '3e3', '0']) == 0
    summary = json.loads((out / 'summary.json').read_text())
    rms = {run['run']: run['rms_m'] for run in summary['runs']}
    assert list(rms) == ['no compensation', 'feedforward', 'with attenuation', 'with PID']
    assert rms['feedforward'] < 0.3 * rms['no compensation']
    assert rms['with attenuation'] < 0.05 * rms['feedforward']
    assert summary['runs'][1]['counters']['0_PhysicalInverse']['clamped_slopes'] == 0
    assert summary['rate_hz'] == 1000.0
    assert (out / 'tracking.png').read_bytes().startswith(b'\x89PNG')
    assert sorted(path.name for path in out.iterdir()) == [MARKER, 'summary.json', 'tracking.png']
    assert 'with attenuation' in capsys.readouterr().out


def test_a_perfect_model_leaves_nothing(files, tmp_path):
    out = tmp_path / 'out'
    words = ['compensate', '--model', files[1], '--plant', files[1], '--attenuation', 'none']
    assert main([*words, '--reference', REFERENCE, '--out', str(out)]) == 0
    runs = json.loads((out / 'summary.json').read_text())['runs']
    assert runs[1]['rms_m'] < 20e-9


@pytest.mark.parametrize(
    'reference',
    [
        'sine:frequenc=23',
        'nothing:frequency=3',
        'sine:frequency',
        'sine:frequency=23,amplitude=1e-4,duration=1e12',
    ],
)
def test_a_bad_reference_is_one_sentence_and_writes_nothing(files, tmp_path, capsys, reference):
    out = tmp_path / 'out'
    assert main(['compensate', *files, '--reference', reference, '--out', str(out)]) == 2
    assert capsys.readouterr().err.startswith('error: ')
    assert not out.exists()


def test_a_model_without_inverse_is_refused(files, tmp_path, capsys):
    bad = tmp_path / 'bad.yaml'
    ModelFile(named('bouc_wen_mode'), {**VALUES, 'A': 160e-6}).save(bad)
    words = ['compensate', '--model', str(bad), *files[2:], '--out', str(tmp_path / 'out')]
    assert main([*words, '--reference', REFERENCE]) == 2
    assert 'no inverse' in capsys.readouterr().err
