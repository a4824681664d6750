"""The demo on a user's own record, and its message for an unusable record."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.simulate import free_runs
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import load
from piezo_hysteresis.reporting.folder import MARKER, replacing


def write_record(path: Path, n: int = 3000, spoil: Any = None) -> Path:
    time = np.arange(n) * 1e-3
    voltage = np.sin(2 * np.pi * 5 * time)
    play = np.empty(n)
    state = 0.0
    for k, u in enumerate(voltage):
        state = min(max(state, u - 0.2), u + 0.2)
        play[k] = state
    noise = 0.02 * np.random.default_rng(1).standard_normal(n)
    rows = np.column_stack([time, voltage, 60 * voltage + 40 * play + noise])
    if spoil is not None:
        rows = spoil(rows)
    np.savetxt(path, rows, '%.9g', ',', header='time_s,voltage_V,displacement_um', comments='')
    return path


@pytest.mark.slow
def test_a_record_becomes_a_model_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_record(tmp_path / 'mine.csv')
    out = tmp_path / 'out'
    assert main(['demo', '--data', str(data), '--out', str(out)]) == 0
    assert 'of its standard deviation' in capsys.readouterr().out
    assert {p.name for p in out.iterdir()} == {
        'model.yaml', 'params.yaml', 'report.html', 'summary.json', MARKER,
    }  # fmt: skip
    summary = json.loads((out / 'summary.json').read_text())
    saved = ModelFile.load(out / 'model.yaml')
    (row,) = free_runs(saved, load([data])).errors
    assert summary['records'][0]['nrmse_percent'] == row.nrmse_percent
    assert row.nrmse_percent < 1.0
    assert summary['choice'][0]['name'] == 'modified'
    (unseen,) = summary['held_out']
    assert unseen['record'] == row.record
    kept = [each for each in summary['choice'] if each['kept']]
    assert unseen['free_run_rms'] in {each['held_out_rms'] for each in kept}
    assert 0.0 < unseen['nrmse_percent'] < 1.0
    ros = yaml.safe_load((out / 'params.yaml').read_text())['/**']['ros__parameters']
    assert ros['model.name'] == summary['model']
    report = (out / 'report.html').read_text()
    assert re.search(r'<p class="verdict">[^<]*within [\d.]+ µm rms', report)


def spoiled_by(index: int, value: float) -> Callable[..., Any]:
    def spoil(rows: np.ndarray) -> np.ndarray:
        rows[500, index] = value
        return rows

    return spoil


@pytest.mark.parametrize(
    ('spoil', 'words'),
    [
        (spoiled_by(1, np.nan), 'not a number'),
        (spoiled_by(0, 0.5004), 'rate|time|step|stamps'),
        (lambda rows: rows[:0], 'empty|no samples|no rows|few'),
        (lambda rows: np.column_stack([rows[:, 0], 0 * rows[:, 1], rows[:, 2]]), 'constant'),
    ],
    ids=['nan', 'uneven', 'empty', 'parked'],
)  # fmt: skip
def test_bad_records_give_one_line_and_leave_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: Any, words: str
) -> None:
    data = write_record(tmp_path / 'bad.csv', spoil=spoil)
    assert main(['demo', '--data', str(data), '--out', str(tmp_path / 'out')]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith('error: ')
    assert re.search(words, lines[0])
    assert [p.name for p in tmp_path.iterdir()] == ['bad.csv']


def test_a_missing_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['demo', '--data', str(tmp_path / 'no.csv'), '--out', str(tmp_path / 'out')]) == 2
    assert 'no.csv' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def fail_half_way(out: Path) -> None:
    with replacing(out, 'demo') as folder:
        (folder / 'a').write_text('half')
        raise KeyboardInterrupt


def test_results_take_the_place_of_old_ones_only_when_they_are_whole(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    with replacing(out, 'demo') as folder:
        (folder / 'a').write_text('old')
        (folder / 'bags').mkdir()
        (folder / 'bags' / 'x').write_text('old')
    (out / 'kept').write_text('kept')
    with pytest.raises(KeyboardInterrupt):
        fail_half_way(out)
    assert (out / 'a').read_text() == 'old'
    with replacing(out, 'demo') as folder:
        (folder / 'a').write_text('new')
        (folder / 'bags').mkdir()
        (folder / 'bags' / 'y').write_text('new')
    assert (out / 'a').read_text() == 'new'
    assert (out / 'kept').read_text() == 'kept'
    assert [p.name for p in (out / 'bags').iterdir()] == ['y']
    assert [p.name for p in tmp_path.iterdir()] == ['out']


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / 'out').write_text('x')
    with pytest.raises(PiezoError, match='it is a file'), replacing(tmp_path / 'out', 'demo'):
        pass
