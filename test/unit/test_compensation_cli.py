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
OFF = ('--set', 'attenuation.enabled=false')
PID = ('--set', 'feedback.method=pid', 'feedback.pid.integral=3e3')
H_INFINITY = '--set feedback.method=h_infinity'
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
    assert main([*words, '--set', 'attenuation.orders=[0,1,3]', *PID]) == 0
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
    words = ['compensate', '--model', files[1], '--plant', files[1], *OFF]
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
    gain = 'feedback.pid.integral=5e4'
    rms, _ = study(files, tmp_path, *OFF, 'feedback.method=pid', gain, reference=SLOW)
    assert rms['with PID'] < 0.5 * rms['feedforward']
    rms, _ = study(files, tmp_path, *OFF, 'feedback.method=fuzzy_pid', gain, reference=SLOW)
    assert rms['with fuzzy PID'] < 0.5 * rms['feedforward']
    words = ('feedback.method=h_infinity', 'feedback.h_infinity.bandwidth=8')
    rms, summary = study(files, tmp_path, *OFF, *words, reference=SLOW)
    assert rms['with H-infinity'] < 0.5 * rms['feedforward']
    (note,) = (each for each in summary['notes'] if each.startswith('H-infinity: gamma 0.'))
    assert note in capsys.readouterr().out


@pytest.mark.slow
def test_tables_of_a_user_change_the_fuzzy_pid(files: list[Any], tmp_path: Path) -> None:
    rows = {level: [3] * 7 for level in ('NB', 'NM', 'NS', 'ZO', 'PS', 'PM', 'PB')}
    table = tmp_path / 'mine.yaml'
    table.write_text(yaml.safe_dump({'proportional': rows, 'integral': rows}))
    words = (
        *OFF, 'feedback.method=fuzzy_pid', 'feedback.pid.integral=2e4',
        'feedback.fuzzy.error_scale=5e-7', 'feedback.fuzzy.rate_scale=1e-5',
        'feedback.fuzzy.integral_range=2e4',
    )  # fmt: skip
    own, _ = study(files, tmp_path, *words, reference=SLOW)
    mine, _ = study(files, tmp_path, *words, f'feedback.fuzzy.tables={table}', reference=SLOW)
    assert mine['with fuzzy PID'] < 0.95 * own['with fuzzy PID']  # all of the integral, always


@pytest.mark.component
def test_no_two_runs_of_a_report_have_one_colour(files: list[Any], tmp_path: Path) -> None:
    study(files, tmp_path, *PID, '--together')
    page = (tmp_path / 'out' / 'report.html').read_text()
    for role in ('uncompensated', 'feedforward', 'attenuated', 'fed_back', 'everything'):
        assert ROLES[role] in page
    assert len({ROLES[role] for role in ('fed_back', 'everything', 'attenuated')}) == 3


@pytest.mark.component
def test_attenuation_and_feedback_may_act_together(files: list[Any], tmp_path: Path) -> None:
    rms, _ = study(files, tmp_path, *PID, 'attenuation.orders=[0,1,3]', '--together')
    assert list(rms)[2:] == ['with attenuation', 'with PID', 'with both']
    assert rms['with both'] < rms['feedforward']


@pytest.mark.slow
def test_sign_rules_are_settings_of_the_attenuation(files: list[Any], tmp_path: Path) -> None:
    """Fujii's printed rule has the wrong sign below the mode, the computed one has not."""
    words = ('--set', 'attenuation.method=rls', 'attenuation.orders=[3]')
    reference = 'sine:frequency=20,amplitude=5e-5,duration=6,ramp=0.5'
    computed, _ = study(files, tmp_path, *words, reference=reference)
    printed, _ = study(
        files, tmp_path, *words, 'attenuation.sign_rule=printed', reference=reference
    )
    assert computed['with attenuation'] < computed['feedforward']
    assert printed['with attenuation'] > computed['with attenuation']


@pytest.mark.slow
def test_the_laws_of_the_papers_are_chosen_by_name(files: list[Any], tmp_path: Path) -> None:
    exact, _ = study([*files[:3], files[1]], tmp_path, *OFF, 'feedforward.law=exact')
    late, summary = study([*files[:3], files[1]], tmp_path, *OFF, 'feedforward.law=zhou2021')
    assert late['feedforward'] > 3 * exact['feedforward']
    assert summary['law'] == 'zhou2021'


def test_the_selector_is_a_model_like_any_other(tmp_path: Path) -> None:
    model = named('inverse_selector')
    ModelFile(model, model.defaults()).save(tmp_path / 'selector.yaml')
    both = ['--model', str(tmp_path / 'selector.yaml'), '--plant', str(tmp_path / 'selector.yaml')]
    rms, _ = study(both, tmp_path, *OFF, 'feedforward.law=xiao2014')
    assert rms['feedforward'] < 0.1 * rms['no compensation']


# --- a simulated plant ------------------------------------------------------------------------


@pytest.mark.slow
def test_a_preset_of_the_simulator_is_a_plant(files: list[Any], tmp_path: Path) -> None:
    plain = [*files[:2], '--plant', 'preset:generic_bouc_wen']
    rms, summary = study(plain, tmp_path, *OFF)
    assert summary['plant'] == 'preset:generic_bouc_wen'
    assert rms['feedforward'] < rms['no compensation']
    again, _ = study(plain, tmp_path, *OFF)
    assert again == rms
    crept, _ = study(plain, tmp_path, *OFF, '--plant-set', 'effects.creep=true')
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
        '--model', str(folder / 'model.yaml'), '--plant', 'preset:xiao_pi_stack', *OFF,
        'feedforward.law=xiao2014', '--plant-set', 'amplifier.range_low=-30',
        'amplifier.range_high=130', '--reference',
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
    words = ['--model', str(poor), *files[2:], '--set', 'attenuation.method=rls',
             'attenuation.orders=[3]', 'attenuation.forgetting=1']  # fmt: skip
    alone, _ = study(words, tmp_path, reference=REFERENCE)
    steered, summary = study(
        [*words, f'attenuation.model_file={files[1]}'], tmp_path, reference=REFERENCE
    )
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
        (f'{H_INFINITY} feedback.h_infinity.bandwidth=600', 'beyond half the sampling rate'),
        (f'{H_INFINITY} feedback.h_infinity.bandwidth=200', 'gamma is'),
        (f'{H_INFINITY} feedback.h_infinity.peak=x', 'h_infinity.peak must be of type float'),
        (f'{H_INFINITY} feedback.h_infinity.peek=2', 'did you mean feedback.h_infinity.peak?'),
        ('--set feedback.h_infinity.bandwidth=5', 'bandwidth changes nothing here'),
        ('--set feedback.limits.low=-1', 'low changes nothing here'),
        ('--set attenuation.sign_rule=guessed', 'sign_rule'),
        ('--set attenuation.orders=3', 'orders must be a list of int'),
        ('--set coupled.step=0.1', 'sets no parameter of feedforward, attenuation, feedback'),
        ('--set attenuation.orders=[1, 3]', "write a list without spaces, or in quotes: 'att"),
        ('--set attenuation.orders=[]', 'orders is empty; give values, or attenuation.enabled='),
        ('--set attenuation.orders=[1] attenuation.orders=[3]', 'orders is given twice'),
        ('--set orders', 'write NODE.PARAMETER=VALUE'),
        ('--transfer-function plant.yaml', 'belongs to feedback.method=h_infinity'),
        ('--set feedforward.law=tatebatake2017', 'inverts bouc_wen and autoregressive'),
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


@pytest.mark.parametrize('verb', ['compensate', 'export'])
def test_an_option_of_earlier_versions_says_what_it_is_now(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([verb, 'model.yaml', '--orders', '1', '3'])
    assert ended.value.code == 2
    assert '--orders is now --set attenuation.orders=VALUE' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([verb, 'model.yaml', '--resonance', '68'])
    assert '--resonance is now --set attenuation.resonance=VALUE' in capsys.readouterr().err
