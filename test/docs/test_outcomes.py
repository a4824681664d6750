"""Every page is followed as its reader would, and what comes out is what the page states.

What is expected stands in the pages, as comments beside the commands: see `expectations.py`.
"""

from __future__ import annotations

import fcntl
import html
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest
from following import Follower, follow, prepare
from pages import ROOT, blocks_of, pages

pytestmark = [pytest.mark.slow, pytest.mark.outcome]

PACKAGES = ('piezo_hysteresis', 'piezo_sim')


def followed() -> Iterator[object]:
    """Yield the pages of which something is run; those with nodes need ROS."""
    for page in pages():
        run = [b for b in blocks_of(page) if b.expected and b.not_run is None]
        if run:
            marks = [pytest.mark.ros] if any(block.is_live for block in run) else []
            yield pytest.param(page, marks=marks, id=page.relative_to(ROOT).as_posix())


@pytest.fixture
def domain() -> Iterator[dict[str, str]]:
    processes = pytest.importorskip('piezo_hysteresis.ros.processes')
    # Pages name ports: one page with nodes at a time on this machine.
    with (Path(tempfile.gettempdir()) / 'piezo_pages.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with processes.NodeProcesses() as group:
            yield {k: v for k, v in group.environment.items() if os.environ.get(k) != v}


@pytest.mark.parametrize('page', list(followed()))
def test_a_page_does_what_it_states(
    page: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    more: dict[str, str] = {}
    if request.node.get_closest_marker('ros'):
        more.update(request.getfixturevalue('domain'))
    if page.name == 'add_effect.md':
        more.update(own_clone(tmp_path))
    follow(page, tmp_path, prepare(tmp_path, **more))


def own_clone(folder: Path) -> dict[str, str]:
    """Make the folder a clone of the reader's own: only the kernel that is new is compiled."""
    for name in ('src', 'docs', 'tools', 'test', 'config', 'bench', 'studies'):
        unused = ('ros', 'property', 'blind') if name == 'test' else ()
        ignore = shutil.ignore_patterns('__pycache__', *unused)
        shutil.copytree(ROOT / name, folder / name, ignore=ignore)
    for file in ('pyproject.toml', 'README.md', 'CITATION.cff', 'CHANGELOG.md'):
        shutil.copy(ROOT / file, folder / file)
    rest = os.environ.get('PYTHONPATH', '')
    return {'PYTHONPATH': f'{folder}/src/piezo_hysteresis{os.pathsep}{rest}'}


def test_the_command_that_identify_recommends_finds_what_is_missing(tmp_path: Path) -> None:
    """The report of the README's identification says what to do next: that is done."""
    blocks = blocks_of(ROOT / 'README.md')
    (five_minutes,) = [block.text for block in blocks if 'identify out/sweep' in block.text]
    bash(tmp_path, '\n'.join(five_minutes.splitlines()[:4]))
    report = html.unescape((tmp_path / 'out' / 'model' / 'report.html').read_text('utf-8'))
    commands = re.findall(
        r'<code>((?:piezo|python -m piezo_hysteresis) discover out/sweep .*?)</code>', report
    )
    assert len(commands) == 1
    bash(tmp_path, f'{commands[0]} --time-limit 300')  # on a busy machine
    folder = tmp_path / shlex.split(commands[0])[shlex.split(commands[0]).index('--out') + 1]
    verdict = json.loads((folder / 'verdict.json').read_text('utf-8'))
    names = {effect['name'] for effect in verdict['effects']}
    assert names == {'sensor_nonlinearity', 'nonlocal_memory'}, verdict['summary']
    held_out = verdict['held_out']
    assert held_out['after_in_floors'] < 0.2 * held_out['before_in_floors']


def bash(folder: Path, command: str) -> None:
    done = subprocess.run(
        ['bash', '-eo', 'pipefail', '-c', command], cwd=folder, env=prepare(folder),
        capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f'{command}: {done.stdout[-1000:]}{done.stderr[-2000:]}'


# A person who installs the suite has none of this workspace: another home, and own settings.
FOREIGN = {'LC_ALL': 'de_DE.UTF-8', 'LANG': 'de_DE.UTF-8', 'PYTHONDONTWRITEBYTECODE': '1'}
IMPORTANT = (
    'test_records_csv', 'test_records_bags', 'test_models_file', 'test_cli_bad_input',
    'test_compensation_inverses', 'test_batch', 'test_reporting_page',
)  # fmt: skip


@pytest.fixture(scope='module')
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the packages without ROS into an environment; return the variables to use it."""
    folder = tmp_path_factory.mktemp('installed')
    shutil.copytree(ROOT / 'config', folder / 'config')
    for name in PACKAGES:
        shutil.copytree(ROOT / 'src' / name, folder / 'src' / name)
    venv.create(folder / 'venv')
    python = folder / 'venv' / 'bin' / 'python'
    # What the packages need is there already; they themselves are not.
    (own,) = (folder / 'venv').glob('lib/*/site-packages')
    (own / 'needed.pth').write_text('\n'.join(p for p in sys.path if p.endswith('site-packages')))
    sources = [str(folder / 'src' / name) for name in PACKAGES]
    words = [sys.executable, '-m', 'pip', '--python', str(python), 'install', '-q']
    words += ['--no-index', '--no-build-isolation', '--disable-pip-version-check', *sources]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    shutil.rmtree(folder / 'src')
    # Kernels are found by what they say, not by where they lie; `.ci/run` begins with none.
    (folder / 'cache').mkdir()
    (folder / 'cache' / 'piezo_kernels').symlink_to(ROOT / 'install' / 'kernels')
    gone = ('PYTHONPATH', 'AMENT_PREFIX_PATH', 'VIRTUAL_ENV')
    return {
        **dict.fromkeys(gone, ''),
        'PATH': f'{python.parent}:{os.environ["PATH"]}',
        'NUMBA_CACHE_DIR': str(folder / 'cache'),
        **FOREIGN,
    }


@pytest.fixture
def private() -> Iterator[None]:
    """Let nobody else read what is written."""
    before = os.umask(0o077)
    yield
    os.umask(before)


@pytest.mark.usefixtures('private')
def test_the_five_minutes_from_an_installed_tree(
    tmp_path: Path, installed: dict[str, str]
) -> None:
    env = prepare(tmp_path, **installed)
    (tmp_path / 'setup.bash').write_text('# what pip has installed needs none\n')
    blocks = [b for b in blocks_of(ROOT / 'README.md') if 'out/' in b.text and not b.is_live]
    with Follower(tmp_path, env).session() as follower:
        follower.follow([b for b in blocks if 'make' not in b.text])
    modes = {path.stat().st_mode & 0o077 for path in (tmp_path / 'out').rglob('*')}
    assert modes == {0}


@pytest.mark.usefixtures('private')
@pytest.mark.parametrize('name', IMPORTANT)
def test_important_tests_pass_from_an_installed_tree(
    tmp_path: Path, installed: dict[str, str], name: str
) -> None:
    env = prepare(tmp_path, **installed)
    test = str(ROOT / 'test' / 'unit' / f'{name}.py')
    words = ['python', '-m', 'pytest', '-q', '-p', 'no:xdist', '-m', 'not slow', test]
    done = subprocess.run(
        words, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=1800, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]


def test_the_notebook_runs_and_shows_what_it_draws() -> None:
    """Its cells assert what they promise; what it has stored is of these cells."""
    tool = [sys.executable, str(ROOT / 'tools' / 'write_notebook.py'), '--check']
    done = subprocess.run(tool, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    text = (ROOT / 'docs' / 'tutorials' / 'python.ipynb').read_text('utf-8')
    code = [cell for cell in json.loads(text)['cells'] if cell['cell_type'] == 'code']
    assert [cell['execution_count'] for cell in code] == list(range(1, len(code) + 1))
    for cell in code:
        kinds = {output['output_type'] for output in cell['outputs']}
        source = ''.join(cell['source'])
        assert ('display_data' in kinds) == ('plt.subplots' in source or '.plot(' in source)
        assert ('stream' in kinds) == ('print(' in source or 'subprocess.run' in source)
