"""Folders of results: whole or not at all, and never over those of another verb."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.reporting.folder import (
    MARKER,
    check_folder,
    claim,
    clear,
    marker_of,
    overwrite,
    replacing,
    write_folder,
)


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# --- the mechanism ------------------------------------------------------------------------------


def test_a_verb_replaces_its_own_results_whole(tmp_path: Path) -> None:
    write_folder(tmp_path, {'summary.json': '{"method": "rls"}', 'a.png': b'1'}, 'identify')
    (tmp_path / 'remarks.txt').write_text('mine')
    write_folder(tmp_path, {'summary.json': '{"method": "pso"}', 'b.png': b'2'}, 'identify')
    assert set(content(tmp_path)) == {'summary.json', 'b.png', 'remarks.txt', MARKER}
    assert 'pso' in (tmp_path / 'summary.json').read_text()


def test_another_verb_changes_nothing(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    write_folder(out, {'summary.json': '{}'}, 'identify')
    before = content(out)
    with pytest.raises(PiezoError, match=r'holds the results of identify; give discover .*--over'):
        write_folder(out, {'verdict.json': '{}'}, 'discover')
    with pytest.raises(PiezoError, match='holds the results of identify'), replacing(out, 'demo'):
        pytest.fail('nothing may be made')
    assert content(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ['out']


def test_files_of_a_person_are_not_written_over(tmp_path: Path) -> None:
    (tmp_path / 'model.yaml').write_text('by hand')
    for refuse in (check_folder, claim, clear):
        with pytest.raises(PiezoError, match='holds files that are no results; give identify'):
            refuse(tmp_path, 'identify')
    with pytest.raises(PiezoError, match='no results'):
        write_folder(tmp_path, {'a.png': b'1'}, 'identify')
    assert content(tmp_path) == {'model.yaml': b'by hand'}


def test_overwrite_makes_a_folder_the_verbs_own(tmp_path: Path) -> None:
    overwrite(tmp_path / 'new', 'identify')
    assert not (tmp_path / 'new').exists()
    (tmp_path / 'mine.txt').write_text('mine')
    overwrite(tmp_path, 'identify')
    write_folder(tmp_path, {'summary.json': '{}', 'a.png': b'1'}, 'identify')
    overwrite(tmp_path, 'discover')
    write_folder(tmp_path, {'summary.json': '[]'}, 'discover')
    assert set(content(tmp_path)) == {'summary.json', 'mine.txt', MARKER}
    found = marker_of(tmp_path)
    assert found is not None
    assert found.verb == 'discover'


def test_a_marker_leads_to_no_other_folder(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    out.mkdir()
    (tmp_path / 'precious').write_text('x')
    names = ['../precious', '..', '.', '', 7, str(tmp_path / 'precious')]
    (out / MARKER).write_text(json.dumps({'verb': 'identify', 'files': names}))
    write_folder(out, {'summary.json': '{}'}, 'identify')
    with replacing(out, 'identify') as made:
        (made / 'summary.json').write_text('{}')
    assert (tmp_path / 'precious').read_text() == 'x'


@pytest.mark.parametrize('text', ['', '[]', '{"verb": 3}', '{"verb": "identify", "files": 5}'])
def test_a_broken_marker_is_no_accident(tmp_path: Path, text: str) -> None:
    (tmp_path / MARKER).write_text(text)
    overwrite(tmp_path, 'identify')
    write_folder(tmp_path, {'summary.json': '{}'}, 'identify')
    assert json.loads((tmp_path / MARKER).read_text())['files'] == ['summary.json']


def test_a_claim_leaves_what_is_there(tmp_path: Path) -> None:
    claim(tmp_path, 'batch identify')
    write_folder(tmp_path, {'results.csv': 'a'}, 'batch identify')
    claim(tmp_path, 'batch identify')
    assert (tmp_path / 'results.csv').read_text() == 'a'
    with pytest.raises(PiezoError, match='results of batch identify'):
        claim(tmp_path, 'batch discover')


def test_a_demo_deletes_the_files_of_the_last_one(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    for name in ('old.png', 'new.png'):
        with replacing(out, 'demo') as made:
            (made / name).write_text('')
    assert set(content(out)) == {'new.png', MARKER}


# --- the verbs ----------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a record and a model."""
    folder = tmp_path_factory.mktemp('files')
    model = named('classical')
    time = np.arange(2000) * 1e-3
    voltage = np.sin(2 * np.pi * 5 * time)
    displacement = model.respond(voltage, model.pack({}), 1e-3)
    rows = np.column_stack([time, voltage, 1e6 * displacement])
    head = 'time_s,voltage_V,displacement_um'
    np.savetxt(folder / 'one.csv', rows, '%.9g', ',', header=head, comments='')
    ModelFile(model, model.defaults()).save(folder / 'model.yaml')
    return folder / 'one.csv', folder / 'model.yaml'


Words = Callable[[Path, Path], list[str]]
VERBS: dict[str, Words] = {
    'identify': lambda data, _: ['identify', str(data), '--model', 'classical'],
    'validate': lambda data, model: ['validate', str(data), '--model', str(model)],
    'discover': lambda data, _: ['discover', str(data), '--baseline', 'classical'],
    'compensate': lambda _, model: [
        'compensate', '--model', str(model), '--plant', str(model),
        '--set', 'attenuation.enabled=false',
        '--reference', 'sine:frequency=5,amplitude=1e-6,duration=0.4',
    ],
    'demo': lambda data, _: ['demo', '--data', str(data)],
    'batch': lambda data, _: ['batch', 'identify', str(data), '--model', 'classical'],
}  # fmt: skip


@pytest.mark.parametrize('verb', VERBS)
def test_no_verb_writes_over_another(
    verb: str, files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    write_folder(out, {'model.yaml': 'x', 'report.html': 'x'}, 'something else')
    before = content(out)
    assert main([*VERBS[verb](*files), '--out', str(out)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f'error: {out} holds the results of something else; give {verb}')
    assert content(out) == before


@pytest.mark.slow
@pytest.mark.parametrize('verb', ['identify', 'validate', 'compensate'])
def test_a_verb_takes_its_own_folder_again(
    verb: str, files: tuple[Path, Path], tmp_path: Path
) -> None:
    words = [*VERBS[verb](*files), '--out', str(tmp_path / 'out')]
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'mine.txt').write_text('mine')
    assert main(words) == 2
    assert main([*words, '--overwrite']) == 0
    (tmp_path / 'out' / 'mine.txt').unlink()
    assert main(words) == 0
    found = marker_of(tmp_path / 'out')
    assert found is not None
    assert found.verb == verb
    assert set(found.files) == set(content(tmp_path / 'out')) - {MARKER}


def test_results_have_the_permissions_of_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        write_folder(tmp_path / 'out', {'summary.json': '{}', 'a.png': b'1'}, 'identify')
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / 'out').iterdir()} == {0o600}
