"""The tutorials run as they stand: every block, in the order in which a reader types them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from pages import ROOT, Terminal, blocks_of, environment, run

TUTORIALS = ROOT / 'docs' / 'tutorials'


def follow(page: str, folder: Path, **more: str) -> None:
    """Run all blocks of a page."""
    env = environment(folder, **more)
    for block in blocks_of(TUTORIALS / f'{page}.md'):
        if block.language in ('bash', 'python'):
            assert block.note != 'terminal'
            run(block, folder, env)


@pytest.fixture(scope='module')
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which the first tutorial was followed."""
    folder = tmp_path_factory.mktemp('lab')
    follow('identify', folder)
    return folder


@pytest.mark.slow
def test_identify_then_compensate(lab: Path) -> None:
    assert 'report.html' in {path.name for path in (lab / 'model').iterdir()}
    follow('compensate', lab)
    runs = json.loads((lab / 'attenuated' / 'summary.json').read_text())['runs']
    sizes = [each['rms_m'] for each in runs]
    assert sizes[-1] < 0.1 * sizes[1] < 0.1 * sizes[0]  # what the page promises
    # in the figures of the picture, which is drawn of such a folder
    assert sizes == pytest.approx([22.0e-6, 3.0e-6, 0.014e-6], rel=0.2)


@pytest.mark.slow
def test_discover(tmp_path: Path) -> None:
    follow('discover', tmp_path)
    worst = {
        name: max(
            row['nrmse_percent']
            for row in json.loads((tmp_path / name / 'summary.json').read_text())['records']
        )
        for name in ('without', 'with')
    }
    assert worst['with'] < 0.5 * worst['without']


@pytest.mark.slow
def test_add_an_effect(tmp_path: Path) -> None:
    # a clone of the reader's own: only the kernel that is new is compiled
    for folder in ('src', 'docs', 'tools', 'test', 'config', 'bench'):
        shutil.copytree(
            ROOT / folder,
            tmp_path / folder,
            ignore=shutil.ignore_patterns('__pycache__', 'ros', 'property', 'blind'),
        )
    for file in ('pyproject.toml', 'README.md', 'CITATION.cff', 'CHANGELOG.md', 'Makefile'):
        shutil.copy(ROOT / file, tmp_path / file)
    rest = os.environ.get('PYTHONPATH', '')
    own = tmp_path / 'src' / 'piezo_hysteresis'
    follow('add_effect', tmp_path, PYTHONPATH=f'{own}{os.pathsep}{rest}')


@pytest.fixture
def domain() -> Iterator[dict[str, str]]:
    processes = pytest.importorskip('piezo_ros_common.processes')
    with processes.NodeProcesses() as group:
        yield group.environment


@pytest.mark.slow
@pytest.mark.ros
def test_driver(tmp_path: Path, domain: dict[str, str]) -> None:
    from piezo_hysteresis.errors import PiezoError
    from piezo_hysteresis.records import load

    env = environment(tmp_path, **domain)
    open_ones: list[Terminal] = []
    for block in blocks_of(TUTORIALS / 'driver.md'):
        if block.note == 'terminal':
            open_ones.append(Terminal(block, tmp_path, env))
            continue
        if block.language == 'bash' and open_ones:
            deadline = time.monotonic() + 120
            while recorded(tmp_path / 'first_record', load, PiezoError) < 3000:
                assert time.monotonic() < deadline
                time.sleep(0.5)
            while open_ones:
                open_ones.pop().ctrl_c()
        if block.language in ('bash', 'python'):
            run(block, tmp_path, env)
    found = json.loads((tmp_path / 'driven' / 'summary.json').read_text())
    assert found['parameters']['A1']['value'] == pytest.approx(1.2e-4, rel=0.05)


@pytest.mark.slow
@pytest.mark.ros
def test_investigate(tmp_path: Path, domain: dict[str, str]) -> None:
    env = environment(tmp_path, **domain)
    open_ones: list[Terminal] = []
    for block in blocks_of(TUTORIALS / 'investigate.md'):
        if block.note == 'terminal':
            open_ones.append(Terminal(block, tmp_path, env))
        elif block.language == 'bash':
            run(block, tmp_path, env)
    while open_ones:
        open_ones.pop().ctrl_c()
    found = json.loads((tmp_path / 'lab' / 'changed' / 'investigation.json').read_text())
    assert list(found['effects']) == ['creep']
    assert found['after_in_floors'] < 0.5 * found['before_in_floors']


def recorded(bag: Path, load, error) -> int:
    try:
        return sum(len(record) for record in load([bag], salvage=True))
    except error:
        return 0


def test_every_tutorial_is_followed_and_listed() -> None:
    listed = (TUTORIALS / 'README.md').read_text()
    followed = Path(__file__).read_text()
    for page in TUTORIALS.glob('*.md'):
        if page.name != 'README.md':
            assert f']({page.name})' in listed
            assert f"'{page.stem}" in followed


sys.path.insert(0, str(ROOT / 'test' / 'unit'))
from test_nodes_scenarios import faults  # noqa: E402

PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])
PARAMETER_FILES = [
    (page, block)
    for page in PAGES
    for block in blocks_of(page)
    if block.language == 'yaml' and 'ros__parameters' in block.text
]


@pytest.mark.parametrize(
    ('page', 'block'), PARAMETER_FILES, ids=lambda each: getattr(each, 'name', '')
)
def test_parameter_files_in_pages_are_taken_by_the_nodes(page: Path, block) -> None:
    assert faults(yaml.safe_load(block.text)) == []


def test_there_are_parameter_files_and_all_yaml_can_be_read() -> None:
    assert len(PARAMETER_FILES) >= 2
    for page in PAGES:
        for block in blocks_of(page):
            if block.language == 'yaml':
                assert yaml.safe_load(block.text) is not None, page.name


@pytest.mark.slow
def test_the_notebook_runs_and_shows_what_it_draws() -> None:
    """Its cells assert what they promise; what it has stored is of these cells."""
    tool = [sys.executable, str(ROOT / 'tools' / 'write_notebook.py'), '--check']
    done = subprocess.run(tool, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    notebook = json.loads((TUTORIALS / 'python.ipynb').read_text('utf-8'))
    code = [cell for cell in notebook['cells'] if cell['cell_type'] == 'code']
    assert [cell['execution_count'] for cell in code] == list(range(1, len(code) + 1))
    for cell in code:
        kinds = {output['output_type'] for output in cell['outputs']}
        source = ''.join(cell['source'])
        assert ('display_data' in kinds) == ('plt.subplots' in source or 'plt.figure' in source)
        assert ('stream' in kinds) == ('print(' in source or 'subprocess.run' in source)
