"""No test is skipped in silence where that is forbidden; reruns are counted, long tests named."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1]

TESTS = """
import pytest
from pathlib import Path
def test_fine(): pass
def test_forbidden(): pytest.skip('no such tool')
def test_permitted(): pytest.skip('never there')
def test_shaky(tmp_path_factory):
    tried = Path(__file__).with_name('tried')
    first = not tried.exists()
    tried.touch()
    assert not first
"""


def run(folder: Path, *words: str, **more: str) -> tuple[int, str]:
    """Run the tests above beside our own conftest; return the exit code and what was printed."""
    shutil.copy(FOLDER / 'conftest.py', folder)
    (folder / 'allowed_skips.txt').write_text('# why\ntest_it.py::test_perm: there is none\n')
    (folder / 'test_it.py').write_text(TESTS)
    (folder / 'test_module.py').write_text("import pytest\npytest.importorskip('no_such_thing')\n")
    (folder / 'tried').unlink(missing_ok=True)
    command = [sys.executable, '-m', 'pytest', '-c', os.devnull, '--rootdir', str(folder), *words]
    environment = {k: v for k, v in os.environ.items() if not k.startswith(('PYTEST', 'PIEZO_NO'))}
    done = subprocess.run(
        command, cwd=folder, env=environment | more, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize('words', [('-n', '2'), ('-p', 'no:xdist')])
def test_a_skip_fails_the_run_where_it_is_forbidden(tmp_path: Path, words: tuple[str]) -> None:
    code, printed = run(tmp_path, '--reruns', '1', *words)
    assert code == 0, printed
    assert 'FAILED' not in printed
    code, printed = run(tmp_path, '--reruns', '1', *words, PIEZO_NO_SKIPS='1')
    assert code == 1, printed
    lines = [line for line in printed.splitlines() if 'allowed_skips.txt does not list it' in line]
    assert sorted(line.split()[1] for line in lines) == [
        'test_it.py::test_forbidden:',
        'test_module.py:',
    ]
    assert 'no such tool' in printed
    assert printed.splitlines()[-1].strip('= ').startswith('2 passed, 3 skipped')


@pytest.mark.slow
def test_tests_that_were_run_again_are_counted_and_named(tmp_path: Path) -> None:
    code, printed = run(tmp_path, '--reruns', '1')
    assert code == 0, printed
    assert 'live tests that needed another try: 1\n  test_it.py::test_shaky' in printed
    code, printed = run(tmp_path)
    assert code == 1, printed
    assert 'another try' not in printed


SPINS = """
import time
from pathlib import Path
def spin(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end: pass
def test_long(): spin(0.5)
def test_once():
    tried = Path(__file__).with_name('tried')
    if not tried.exists():
        tried.touch()
        spin(0.5)
"""


@pytest.mark.slow
def test_what_is_too_long_only_once_passes_and_what_is_too_long_again_fails(
    tmp_path: Path,
) -> None:
    unit = tmp_path / 'unit'
    unit.mkdir()
    (unit / 'test_spins.py').write_text(SPINS)
    _, printed = run(tmp_path, 'unit', PIEZO_UNIT_SECONDS='0.1')
    failed = {line.split()[1] for line in printed.splitlines() if line.startswith('FAILED')}
    assert failed == {'unit/test_spins.py::test_long'}


def test_the_list_gives_a_reason_for_each() -> None:
    lines = (FOLDER / 'allowed_skips.txt').read_text(encoding='utf-8').splitlines()
    listed = [line for line in lines if line and line[0] != '#']
    assert 0 < len(listed) <= 8
    for line in listed:
        name, _, why = line.partition(': ')
        assert (FOLDER.parent / name.partition('::')[0]).is_file()
        assert len(why) > 20
