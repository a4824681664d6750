"""The verb discover: its files, its fields, and its messages for bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, write_bag, write_csv
from piezo_hysteresis.reporting.folder import MARKER
from piezo_sim.sweep import simulate

FIELDS = {
    'baseline',
    'seed',
    'noise_floor_rms_m',
    'held_out',
    'effects',
    'verdict',
    'unexplained',
    'where',
    'next_experiments',
    'records',
    'seconds',
}


def sines(effects: dict[str, float | bool], seed: int = 4) -> list[Record]:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 3.0}
        for a in (1.0, 0.5)
        for f in (2, 7, 23)
    ]
    return simulate('generic_bouc_wen', plan, effects, seed)


@pytest.fixture(scope='module')
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('discover')
    write_bag(folder / 'bag', sines({'effects.electrostriction': True}))
    words = ['discover', str(folder / 'bag'), '--baseline', 'classical', '--workers', '2']
    assert main([*words, '--out', str(folder / 'out'), '--seed', '7']) == 0
    return folder / 'out'


@pytest.mark.component
def test_the_hidden_effect_is_named_and_the_gap_closes(found: Path) -> None:
    verdict = json.loads((found / 'verdict.json').read_text())
    assert set(verdict) >= FIELDS
    assert verdict['verdict'] == 'named'
    assert verdict['effects'][0]['name'] == 'electrostriction'
    assert verdict['effects'][0]['p_value'] < 1e-3
    assert verdict['held_out']['before_in_floors'] > 3.0
    assert verdict['held_out']['after_in_floors'] < 1.2
    assert verdict['seed'] == 7
    assert set(verdict['where'][0]) == {'record', 'frequency_hz', 'harmonic', 'rms_m'}


def test_the_model_is_loadable_and_the_report_is_one_file(found: Path) -> None:
    model = ModelFile.load(found / 'model.yaml')
    assert 'electrostriction' in model.model.block_names
    assert model.provenance.noise_floor == pytest.approx(2e-8, rel=0.2)
    page = (found / 'report.html').read_text()
    assert 'electrostriction' in page
    assert '<script src=' not in page
    assert '<link' not in page
    assert {p.name for p in found.iterdir()} == {
        'verdict.json',
        'model.yaml',
        'params.yaml',
        'report.html',
        MARKER,
    }


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(['discover', *words]) == 2
    printed = capsys.readouterr().err.strip()
    assert printed.startswith('error: ')
    assert '\n' not in printed
    return printed


def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    tail = ['--baseline', 'classical', '--out', str(out)]
    assert 'nowhere' in refused([str(tmp_path / 'nowhere'), *tail], capsys)

    still = Record('still', 1e-3, np.zeros(2000), np.random.default_rng(0).normal(0, 1e-8, 2000))
    write_csv(tmp_path / 'still.csv', still)
    assert 'constant' in refused([str(tmp_path / 'still.csv'), *tail], capsys)

    short = Record('short', 1e-3, np.linspace(0, 1, 50), np.linspace(0, 1e-4, 50))
    write_csv(tmp_path / 'short.csv', short)
    assert 'samples' in refused([str(tmp_path / 'short.csv'), *tail], capsys)

    write_csv(tmp_path / 'good.csv', sines({})[1])
    words = [str(tmp_path / 'good.csv'), '--baseline', 'no_such_model', '--out', str(out)]
    assert 'no_such_model' in refused(words, capsys)
    assert not out.exists()
