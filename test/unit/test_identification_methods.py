"""Every method through one interface, the checks before it and the verbs around it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import identify, online
from piezo_hysteresis.identification.checks import require_each_usable, require_usable
from piezo_hysteresis.identification.error_measures import one_step
from piezo_hysteresis.identification.initial_conditions.record_start import preceded
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.rls import RlsSettings
from piezo_hysteresis.identification.simulate import Unsaved, free_runs
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, RecordInfo, write_csv

DT = 1e-3
MODEL = named('bouc_wen_mode')
TRUTH = {
    'A1': 180e-6,
    'A': 60e-6,
    'A0': 0.0,
    'beta': 2.5,
    'gamma': 1.0,
    'natural_frequency': 68.0,
    'damping_ratio': 0.015,
    'offset': 6e-6,
}


def record(
    frequency: float, seconds: float = 6.0, noise: float = 20e-9, name: str = 'bouc_wen_mode'
) -> Record:
    model = named(name)
    values = {k: v for k, v in TRUTH.items() if k in model.parameter_names}
    u = np.sin(2 * np.pi * frequency * DT * np.arange(round(seconds / DT)))
    y = model.respond(u, model.pack(values), DT)
    if model.answers_at_once:  # measured before the voltage of a tick acts
        y = np.concatenate([[values['offset']], y[:-1]])
    y += np.random.default_rng(int(frequency)).normal(0, noise, u.size)
    info = RecordInfo(excitation='sine', frequency=frequency, amplitude=1.0, warm_up=1.0)
    return Record(f'{frequency:g}Hz', DT, u, y, info=info)


MODE = {'natural_frequency': 68.0, 'damping_ratio': 0.015}
RECORDS = [record(f) for f in (2, 7, 23)]
STIFF = [record(f, name='classical') for f in (2, 7, 23)]


def slow(*values: object) -> Any:
    """Return a case that takes seconds."""
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.component
@pytest.mark.parametrize(
    ('method', 'model', 'options', 'limit'),
    [
        ('output_error', 'bouc_wen_mode', {}, 0.05e-6),
        ('rls_ud', 'bouc_wen_mode', {'start': MODE}, 0.05e-6),
        ('rls', 'extended', {}, 80e-6),
        ('rls_ud', 'classical', {}, 0.5e-6),
        slow('de', 'classical', {'max_evaluations': 3000}, 2e-6),
        slow('pso', 'classical', {'max_evaluations': 4000}, 2e-6),
        ('pso', 'bouc_wen_mode', {'max_evaluations': 1500}, 60e-6),
        ('pso_modified', 'classical', {'max_evaluations': 4000}, 2e-6),
    ],
)
def test_every_method_answers_alike(
    method: str, model: str, options: dict[str, Any], limit: float
) -> None:
    records = STIFF if model == 'classical' else RECORDS
    found = identify(records, named(model), method=method, seed=1, **options)
    assert {row.record for row in found.records} == {r.name for r in RECORDS}
    assert all(row.free_run_rms < limit for row in found.records)
    assert found.correlation.shape == (len(found.names),) * 2
    assert abs(found.sampling_offset) < (1.1 if method == 'rls' else 0.1) * DT
    if model == 'classical':
        # searches end in the valley, not at its bottom: the shape of the loop is told roughly
        for name, share in (('A1', 0.02), ('beta', 0.25)):
            assert found.values[name] == pytest.approx(TRUTH[name], rel=share)
    np.testing.assert_allclose(found.correlation, found.correlation.T, atol=1e-9)
    assert np.all(np.abs(found.correlation) < 1 + 1e-6)
    assert found.condition >= 1
    assert found.noise_floor == pytest.approx(20e-9, rel=0.1)
    text = json.dumps(found.summary(), allow_nan=False)
    assert set(json.loads(text)['parameters']) == set(named(model).parameter_names)


def test_play_bank_online_behind_a_frozen_mode() -> None:
    model = named('prandtl_ishlinskii').with_block(MODEL.blocks[1])
    found = identify(RECORDS, model, method='pi_bank', start=MODE)
    assert all(row.free_run_rms < 2e-6 for row in found.records)
    assert found.model.values['natural_frequency'] == 68.0


@pytest.mark.component
def test_searches_are_seeded() -> None:
    one, same, other = (
        identify(RECORDS, named('classical'), method='pso', seed=s, max_evaluations=300).values
        for s in (1, 1, 2)
    )
    assert one == same != other


@pytest.mark.component
def test_a_fit_in_stages_takes_the_number_of_its_starts() -> None:
    model = 'classical+electrostriction'
    assert identify(STIFF[:1], model, count=2, max_evaluations=5).fit is not None


def test_one_step_error_of_the_papers_recursion() -> None:
    """A(z) on the free-run error is what regression on the measured past leaves."""
    model = named('extended')
    values = {**model.defaults(), 'c1': 0.4, 'c2': -0.75, 'A1': 2e-5, 'A': 4e-6}
    u = RECORDS[1].voltage
    free = model.respond(u, model.pack(values), DT)
    y = free + np.random.default_rng(0).normal(0, 1e-7, u.size)
    v = model.blocks[0].respond(
        u, model.pack(values)[:5], DT, state=model.blocks[0].initial_state(DT)
    )
    o = values['offset']
    predicted = o + (y[2:-1] - o) + 0.4 * (y[1:-2] - o) - 0.75 * (y[:-3] - o) + v[3:]
    np.testing.assert_allclose(
        one_step(model, values, y - free)[3:], y[3:] - predicted, atol=1e-15
    )


def test_errors_leave_out_the_warm_up() -> None:
    r = RECORDS[1]
    spoilt = r.displacement.copy()
    spoilt[: r.warm_up_samples] += 1e-3
    (row,) = free_runs(Unsaved(MODEL, TRUTH, 0.0, 0.0), [replace(r, displacement=spoilt)]).errors
    assert row.free_run_rms == pytest.approx(20e-9, rel=0.05)
    assert row.nrmse_percent == pytest.approx(
        100 * row.free_run_rms / np.std(r.displacement[1000:])
    )


def test_the_past_of_a_record_is_part_of_it() -> None:
    """A remanent rest is missed from the virgin state and met with the past before it."""
    model = named('classical')
    values = {k: v for k, v in TRUTH.items() if k in model.parameter_names}
    t = DT * np.arange(3000)
    before = np.interp(t, [0, 1, 2, 3], [0, 1, -1, 0])
    u = np.concatenate([before, np.sin(2 * np.pi * t)])
    y = np.roll(model.respond(u, model.pack(values), DT), 1)  # read before the voltage acts
    cut = Record('cut', DT, u[3000:], y[3000:])
    given, step = Unsaved(model, values, 0.0, 0.0), RecordAssumptions('step')
    (virgin,) = free_runs(given, [cut], step).errors
    (known,) = free_runs(given, [preceded(cut, [1, -1])], step).errors
    (found,) = free_runs(given, [cut]).errors
    assert known.free_run_rms < 2e-2 * virgin.free_run_rms
    assert found.free_run_rms < 2e-2 * virgin.free_run_rms
    assert found.start.startswith('estimate after')


NOISE = np.random.default_rng(0).normal(size=4000)


@pytest.mark.parametrize(
    ('change', 'word'),
    [
        ({'voltage': np.full(6000, 0.3)}, 'voltage is constant'),
        ({'displacement': np.full(6000, 1e-6)}, 'displacement is constant'),
        ({'displacement': 1e6 * RECORDS[1].displacement}, 'name it with its unit'),
        ({'displacement': 1e-8 * RECORDS[1].displacement}, 'less than an atom'),
        ({'displacement': 1e-6 * np.resize(NOISE, 6000)}, 'nothing in common'),
        ({'dt': 0.05, 'info': RecordInfo(frequency=7.0)}, 'sample at 140 Hz'),
    ],
)
def test_useless_records_are_named_with_what_to_record(change: dict[str, Any], word: str) -> None:
    bad = replace(RECORDS[1], **change)
    with pytest.raises(IdentificationError, match=word):
        identify([bad], MODEL)


def test_short_records_are_named() -> None:
    with pytest.raises(IdentificationError, match='only 10 samples'):
        identify([RECORDS[0].section(0, 10)], MODEL)


def test_doubtful_records_are_fitted_with_a_warning() -> None:
    r = RECORDS[1]
    clipped = replace(r, displacement=np.minimum(r.displacement, 90e-6))
    (sentence,) = require_each_usable([clipped])
    assert 'clipped' in sentence
    early = replace(r, displacement=np.roll(r.displacement, -20))
    assert any('ahead of the voltage' in each for each in require_each_usable([early]))
    fast = replace(r, dt=1.0 / 63.0, info=RecordInfo(frequency=7.0))
    assert any('few harmonics' in each for each in require_each_usable([fast]))
    assert require_each_usable(RECORDS) == []


def test_a_record_at_rest_is_accepted_with_others() -> None:
    rest = Record('rest', DT, np.zeros(2000), 6e-6 + 20e-9 * NOISE[:2000])
    assert require_each_usable([*RECORDS, rest]) == []
    with pytest.raises(IdentificationError, match='constant in every record'):
        require_usable([rest])


def test_staircases_are_not_called_clipped() -> None:
    u = np.repeat([0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0, 1.0, -1.0], 300)
    y = MODEL.respond(u, MODEL.pack(TRUTH), DT)
    assert [
        each for each in require_each_usable([Record('stairs', DT, u, y)]) if 'clipped' in each
    ] == []


def test_methods_refuse_models_they_cannot_identify() -> None:
    for method, model in (('rls', 'preisach'), ('rls_ud', 'extended'), ('pi_bank', 'classical')):
        with pytest.raises(IdentificationError, match=r'use output_error'):
            identify(RECORDS, named(model), method=method)
    with pytest.raises(IdentificationError, match='choose one of'):
        identify(RECORDS, MODEL, method='guess')
    with pytest.raises(IdentificationError, match='do not belong'):
        online('rls_ud', RlsSettings())


def run(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.fixture(scope='module')
def data(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp('data')
    paths = [folder / f'{r.name}.csv' for r in RECORDS]
    for path, each in zip(paths, RECORDS, strict=True):
        write_csv(path, each)
    return paths


@pytest.mark.component
def test_identify_and_validate_leave_their_files(
    data: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    assert run('identify', *data, '--model', 'bouc_wen_mode', '--out', out, '--warm-up', 1) == 0
    assert 'A1' in capsys.readouterr().out
    saved = ModelFile.load(out / 'model.yaml')
    assert saved.values['natural_frequency'] == pytest.approx(68.0, rel=1e-3)
    assert saved.provenance.rate == pytest.approx(1000.0)
    assert 'ros__parameters' in (out / 'params.yaml').read_text()
    assert yaml.safe_load((out / 'params.yaml').read_text())['/**']
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['parameters']['beta'].keys() == {'value', 'std', 'unit'}
    assert {row['record'] for row in summary['records']} == {path.stem for path in data}
    check = tmp_path / 'check'
    assert run('validate', data[0], '--model', out / 'model.yaml', '--out', check,
               '--warm-up', 1) == 0  # fmt: skip
    row = json.loads((check / 'summary.json').read_text())['records'][0]
    assert row['free_run_rms_m'] < 30e-9
    page = (check / 'report.html').read_text()
    for text in ('an error of 0.0199 µm rms', row['record'], 'record with the largest error'):
        assert text in page


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (['--model', 'bouc_when'], 'no model bouc_when'),
        (['--model', 'classical', '--method', 'magic'], 'choose one of'),
        (['--model', 'classical', '--forgetting', '0.9'], 'does not take forgetting'),
        (['--model', 'classical', '--hold', 'A0'], 'NAME=VALUE'),
        (['--model', 'classical', '--hold', 'B0=1'], 'B0'),
        (['--model', 'classical+nothing'], 'nothing'),
    ],
)
def test_wrong_words_are_one_line_and_leave_nothing(
    words: list[str],
    sentence: str,
    data: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / 'out'
    assert run('identify', data[0], '--out', out, *words) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error
    assert error.count('\n') == 0
    assert not out.exists()


@pytest.mark.component
def test_a_folder_that_cannot_be_written_is_named(
    data: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = tmp_path / 'file'
    blocked.write_text('')
    assert run('identify', data[0], '--model', 'classical', '--out', blocked) == 2
    assert 'cannot be written' in capsys.readouterr().err
