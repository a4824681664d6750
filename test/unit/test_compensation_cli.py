"""The verb ``compensate``: correct results, or one sentence and nothing written."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.offline_loop import ProcessPlant, simulated
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.named import named
from piezo_hysteresis.reporting.folder import MARKER
from piezo_hysteresis.reporting.plots import ROLES
from piezo_sim import Plant
from piezo_sim.sweep import simulate

VALUES = {'A1': 150e-6, 'A': 40e-6, 'A0': 0.0, 'beta': 1.0, 'gamma': 0.1, 'offset': 6e-6,
          'natural_frequency': 68.0, 'damping_ratio': 0.015}  # fmt: skip
REFERENCE = 'sine:frequency=23,amplitude=1e-4,duration=10,ramp=1'


@pytest.fixture
def files(tmp_path: Path) -> list[Any]:
    model, plant = tmp_path / 'model.yaml', tmp_path / 'plant.yaml'
    ModelFile(named('bouc_wen_mode'), VALUES).save(model)
    ModelFile(named('bouc_wen_mode'), {**VALUES, 'A': 44e-6, 'natural_frequency': 68.5}).save(
        plant
    )
    return ['--model', str(model), '--plant', str(plant)]


@pytest.mark.component
def test_an_attenuation_without_time_to_begin_is_stated(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = REFERENCE.replace('duration=10', 'duration=0.5').replace('ramp=1', 'ramp=0.1')
    out = str(tmp_path / 'out')
    assert main(['compensate', *files, '--reference', short, '--out', out]) == 0
    printed = capsys.readouterr()
    assert 'with attenuation: 0.5 s are too short' in printed.out + printed.err


@pytest.mark.component
def test_study_reports_each_run_and_what_every_link_gains(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    words = ['compensate', *files, '--reference', REFERENCE, '--out', str(out)]
    assert main([*words, '--orders', '0', '1', '3', '--pid', '0', '3e3', '0']) == 0
    summary = json.loads((out / 'summary.json').read_text())
    rms = {run['run']: run['rms_m'] for run in summary['runs']}
    assert list(rms) == ['no compensation', 'feedforward', 'with attenuation', 'with PID']
    assert rms['feedforward'] < 0.3 * rms['no compensation']
    assert rms['with attenuation'] < 0.05 * rms['feedforward']
    assert summary['runs'][1]['counters']['0_physical_inverse']['clamped_slopes'] == 0
    assert summary['rate_hz'] == 1000.0
    page = (out / 'report.html').read_text()
    assert '<td>harmonic attenuation</td>' in page
    assert 'HarmonicAttenuation' not in page  # words, not names of classes
    assert sorted(path.name for path in out.iterdir()) == [
        MARKER, 'report.html', 'summary.json', 'voltage.csv',
    ]  # fmt: skip
    printed = capsys.readouterr()
    assert 'too short' not in printed.out + printed.err
    page = (out / 'report.html').read_text()
    for run in rms:
        assert run in page
    assert 'The rms tracking error of' in page
    assert 'Plant and model have the same name' in page
    assert 'with attenuation' in printed.out


@pytest.mark.component
def test_a_perfect_model_leaves_nothing(files: list[Any], tmp_path: Path) -> None:
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
def test_a_bad_reference_is_one_sentence_and_writes_nothing(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], reference: str
) -> None:
    out = tmp_path / 'out'
    assert main(['compensate', *files, '--reference', reference, '--out', str(out)]) == 2
    assert capsys.readouterr().err.startswith('error: ')
    assert not out.exists()


def test_a_model_without_inverse_is_refused(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / 'bad.yaml'
    ModelFile(named('bouc_wen_mode'), {**VALUES, 'A': 160e-6}).save(bad)
    words = ['compensate', '--model', str(bad), *files[2:], '--out', str(tmp_path / 'out')]
    assert main([*words, '--reference', REFERENCE]) == 2
    assert 'no inverse' in capsys.readouterr().err


# --- controllers ------------------------------------------------------------------------------

SHORT = 'sine:frequency=5,amplitude=5e-5,duration=3,ramp=0.5'


# Slow enough for an integral that the mode at 68 Hz allows.
SLOW = 'sine:frequency=0.3,amplitude=5e-5,duration=10,ramp=0.5'


def study(files: Any, tmp_path: Any, *words: Any, reference: Any = SHORT) -> Any:
    out = tmp_path / 'out'
    done = main(['compensate', *files, '--reference', reference, '--out', str(out), *words])
    assert done == 0
    content = json.loads((out / 'summary.json').read_text())
    return {run['run']: run['rms_m'] for run in content['runs']}, content


@pytest.mark.component
def test_every_feedback_lowers_the_error(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    none = ('--attenuation', 'none', '--feedback')
    gains = ('--pid', '0', '5e4', '0')
    rms, _ = study(files, tmp_path, *none, 'pid', *gains, reference=SLOW)
    assert rms['with PID'] < 0.5 * rms['feedforward']
    scales = ('--fuzzy', '5e-6', '1e-3', '0', '1e4')
    rms, _ = study(files, tmp_path, *none, 'fuzzy_pid', *gains, *scales, reference=SLOW)
    assert rms['with fuzzy PID'] < 0.5 * rms['feedforward']
    rms, summary = study(files, tmp_path, *none, 'h_infinity', '--bandwidth', '8', reference=SLOW)
    assert rms['with H-infinity'] < 0.5 * rms['feedforward']
    (note,) = (each for each in summary['notes'] if each.startswith('H-infinity: gamma 0.'))
    assert note in capsys.readouterr().out


@pytest.mark.slow
def test_tables_of_a_user_change_the_fuzzy_pid(files: list[Any], tmp_path: Path) -> None:
    rows = {level: [3] * 7 for level in ('NB', 'NM', 'NS', 'ZO', 'PS', 'PM', 'PB')}
    table = tmp_path / 'mine.yaml'
    table.write_text(yaml.safe_dump({'proportional': rows, 'integral': rows}))
    words = ('--attenuation', 'none', '--feedback', 'fuzzy_pid', '--pid', '0', '2e4', '0',
             '--fuzzy', '5e-7', '1e-5', '0', '2e4')  # fmt: skip
    own, _ = study(files, tmp_path, *words, reference=SLOW)
    mine, _ = study(files, tmp_path, *words, '--fuzzy-tables', str(table), reference=SLOW)
    assert mine['with fuzzy PID'] < 0.95 * own['with fuzzy PID']  # all of the integral, always


@pytest.mark.component
def test_no_two_runs_of_a_report_have_one_colour(files: list[Any], tmp_path: Path) -> None:
    study(files, tmp_path, '--pid', '0', '3e3', '0', '--together')
    page = (tmp_path / 'out' / 'report.html').read_text()
    for role in ('uncompensated', 'feedforward', 'attenuated', 'fed_back', 'everything'):
        assert ROLES[role] in page
    assert len({ROLES[role] for role in ('fed_back', 'everything', 'attenuated')}) == 3


@pytest.mark.component
def test_attenuation_and_feedback_may_act_together(files: list[Any], tmp_path: Path) -> None:
    rms, _ = study(
        files, tmp_path, '--orders', '0', '1', '3', '--pid', '0', '2e3', '0', '--together'
    )
    assert list(rms)[2:] == ['with attenuation', 'with PID', 'with both']
    assert rms['with both'] < rms['feedforward']


@pytest.mark.slow
def test_sign_rules_are_settings_of_the_attenuation(files: list[Any], tmp_path: Path) -> None:
    """Fujii's printed rule has the wrong sign below the mode, the computed one has not."""
    words = ('--attenuation', 'rls', '--orders', '3', '--attenuation-set', 'switch_frequency=66')
    reference = 'sine:frequency=20,amplitude=5e-5,duration=6,ramp=0.5'
    computed, _ = study(files, tmp_path, *words, reference=reference)
    printed, _ = study(files, tmp_path, *words, 'sign_rule=printed', reference=reference)
    assert computed['with attenuation'] < computed['feedforward']
    assert printed['with attenuation'] > computed['with attenuation']


@pytest.mark.slow
def test_the_laws_of_the_papers_are_chosen_by_name(files: list[Any], tmp_path: Path) -> None:
    words = ('--attenuation', 'none', '--law')
    exact, _ = study([*files[:3], files[1]], tmp_path, *words, 'exact')
    late, summary = study([*files[:3], files[1]], tmp_path, *words, 'zhou2021')
    assert late['feedforward'] > 3 * exact['feedforward']
    assert summary['law'] == 'zhou2021'


def test_the_selector_is_a_model_like_any_other(tmp_path: Path) -> None:
    model = named('inverse_selector')
    ModelFile(model, model.defaults()).save(tmp_path / 'selector.yaml')
    both = ['--model', str(tmp_path / 'selector.yaml'), '--plant', str(tmp_path / 'selector.yaml')]
    rms, _ = study(both, tmp_path, '--attenuation', 'none', '--law', 'xiao2014')
    assert rms['feedforward'] < 0.1 * rms['no compensation']


# --- a simulated plant ------------------------------------------------------------------------


@pytest.mark.slow
def test_a_preset_of_the_simulator_is_a_plant(files: list[Any], tmp_path: Path) -> None:
    plain = [*files[:2], '--plant', 'preset:generic_bouc_wen']
    words = ('--attenuation', 'none')
    rms, summary = study(plain, tmp_path, *words)
    assert summary['plant'] == 'preset:generic_bouc_wen'
    assert rms['feedforward'] < rms['no compensation']
    again, _ = study(plain, tmp_path, *words)
    assert again == rms
    crept, _ = study(plain, tmp_path, *words, '--plant-set', 'effects.creep=true')
    assert crept != rms


@pytest.fixture(scope='module')
def stack(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the words for a model of Xiao 2014's stack, by its method, and its amplifier."""
    folder = tmp_path_factory.mktemp('stack')
    specs = [
        {'kind': 'triangle', 'frequency': f, 'amplitude': 50.0, 'offset': 50.0, 'duration': 1.0,
         'phase': -0.5 * np.pi}
        for f in (10.0, 100.0)
    ]  # fmt: skip
    found = identify(simulate('xiao_pi_stack', specs), named('inverse_selector'),
                     method='xiao2014', seed=1)  # fmt: skip
    found.model_file((), 1e4).save(folder / 'model.yaml')
    return [
        '--model', str(folder / 'model.yaml'), '--plant', 'preset:xiao_pi_stack', '--law',
        'xiao2014', '--plant-set', 'amplifier.range_low=-30', 'amplifier.range_high=130',
        '--attenuation', 'none', '--reference',
        'triangle:frequency=10,amplitude=15e-6,duration=2',
    ]  # fmt: skip


@pytest.mark.component
def test_a_preset_brings_its_range_slew_offset_and_start(
    stack: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['compensate', *stack, '--out', str(tmp_path / 'out')]) == 0
    output = capsys.readouterr().out
    assert '-30 to 130 V, at most 1.6e+06 V/s; reference about 15 µm, phase -90 degrees' in output
    assert 'limited' not in output
    runs = json.loads((tmp_path / 'out' / 'summary.json').read_text())['runs']
    assert runs[1]['rms_m'] < 1.2084e-6  # table 1 of Xiao 2014


@pytest.mark.component
def test_what_was_limited_is_on_the_terminal_and_in_the_summary(
    stack: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['compensate', *stack, '--slew', '1000', '--out', str(tmp_path / 'out')]
    assert main(words) == 0
    line = next(row for row in capsys.readouterr().out.splitlines() if 'slowed down' in row)
    assert 'of 20000 samples' in line
    assert 'to 1000 V/s' in line
    assert line in json.loads((tmp_path / 'out' / 'summary.json').read_text())['notes']


@pytest.mark.component
def test_the_gain_of_another_model_steers_the_attenuation(
    files: list[Any], tmp_path: Path
) -> None:
    """A model without a resonance knows nothing of the gain at 69 Hz; one with it does."""
    poor = tmp_path / 'poor.yaml'
    ModelFile(
        named('classical'), {k: VALUES[k] for k in ('A1', 'A', 'A0', 'beta', 'gamma', 'offset')}
    ).save(poor)
    words = ['--model', str(poor), *files[2:], '--attenuation', 'rls', '--orders', '3',
             '--attenuation-set', 'forgetting=1', 'sign_rule=computed']  # fmt: skip
    alone, _ = study(words, tmp_path, reference=REFERENCE)
    steered, summary = study([*words, '--gain-model', files[1]], tmp_path, reference=REFERENCE)
    assert summary['gain_model'] == 'bouc_wen_mode'
    assert steered['with attenuation'] < 0.9 * alone['with attenuation'], (steered, alone)


@pytest.mark.component
def test_the_plant_of_another_process_is_the_plant_to_the_bit() -> None:
    voltage = np.sin(2 * np.pi * 5 * np.arange(500) * 1e-3)
    there = simulated('generic_bouc_wen', 1000.0, seed=3)
    try:
        assert there.about['preset'] == 'generic_bouc_wen'
        first = [there.exchange(float(v)) for v in voltage]
        there.reset()
        again = [there.exchange(float(v)) for v in voltage]
    finally:
        there.close()
    here = Plant.from_preset('generic_bouc_wen', 1000.0, 3)
    np.testing.assert_array_equal(first, [here.exchange(float(v)) for v in voltage])
    np.testing.assert_array_equal(first, again)


def test_a_plant_that_ends_is_reported(tmp_path: Path) -> None:
    code = 'print("{}", flush=True); import sys; sys.exit("error: it broke")'
    plant = ProcessPlant([sys.executable, '-c', code])
    with pytest.raises(CompensationError, match='the plant has ended: it broke'):
        plant.exchange(0.0)
    plant.close()
    with pytest.raises(CompensationError, match='cannot be started: the path does not exist'):
        ProcessPlant([str(tmp_path / 'nowhere')])


@pytest.mark.component
@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ('--plant preset:nobody', 'cannot be started: there is no preset'),
        ('--plant preset:generic_bouc_wen --plant-set colour=3', 'cannot be started'),
        ('--plant preset:generic_bouc_wen --noise 1e-8', 'its own noise'),
        ('--plant-set effects.creep=true', '--plant-set is for a simulated plant'),
        ('--feedback pid', '--feedback pid needs --pid'),
        ('--feedback fuzzy_pid --pid 0 1 0', 'needs --fuzzy'),
        ('--feedback h_infinity', 'needs --bandwidth'),
        ('--feedback h_infinity --bandwidth 600', 'beyond half the sampling rate'),
        ('--feedback h_infinity --bandwidth 200', 'gamma is'),
        ('--feedback h_infinity --bandwidth 5 --h-infinity-set peak=x', 'peak must be a number'),
        ('--feedback h_infinity --bandwidth 5 --h-infinity-set size=2', 'no setting of h_inf'),
        ('--bandwidth 5', '--bandwidth belongs to --feedback h_infinity'),
        ('--pid 0 1 0 --fuzzy 1 1 1 1', '--fuzzy belongs to --feedback fuzzy_pid'),
        ('--attenuation-set sign_rule=guessed', 'sign_rule'),
        ('--attenuation-set gain=big', 'gain must be a number'),
        ('--attenuation-set orders=3', 'no setting of the attenuation'),
        ('--law tatebatake2017', 'inverts bouc_wen and autoregressive'),
    ],
)
def test_what_cannot_be_is_one_line(
    words: str, says: str, files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [files[3] if word == 'PLANT' else word for word in words.split()]
    out = tmp_path / 'out'
    asked = ['compensate', *files, '--reference', SHORT, '--out', str(out), *given]
    assert main(asked) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert says in lines[0]
    assert not out.exists()
