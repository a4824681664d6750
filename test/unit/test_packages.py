"""package.xml names what a package imports; the lane of ROS 2 Kilted."""

from __future__ import annotations

import ast
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.quick import ROOT

SOURCES = Path(__file__).parents[2] / 'src'
PACKAGES = [
    p.parent.name for p in SOURCES.glob('*/package.xml') if (p.parent / 'setup.py').exists()
]
KEYS = {'yaml': 'python3-yaml', 'bokeh': 'python3-bokeh-pip', 'llvmlite': 'python3-numba'}
# By pip where there is no key, or what comes with another that is named.
ELSEWHERE = {
    *('rosbags', 'pyarrow', 'shtab', 'h5py', 'openpyxl', 'nptdms'),  # requirements.txt
    *('apsw', 'lz4', 'backports'),  # of rosbags
    *('jinja2',),  # of bokeh
    *('asammdf', 'igor2', 'pyuff'),  # the extra instruments
    *('distributed', 'pandas'),  # where a user brings a cluster, or wants data frames
}


def imported(folder: Any) -> Iterator[str]:
    for path in folder.rglob('*.py'):
        if path.name == 'setup.py':
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                yield from (alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield str(node.module).split('.')[0]


@pytest.mark.component
@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_every_import_is_a_named_dependency(package: Any) -> None:
    text = (SOURCES / package / 'package.xml').read_text()
    named = set(re.findall(r'<(?:exec_)?depend>([^<]+)<', text))
    foreign = {
        name
        for name in imported(SOURCES / package)
        if name not in sys.stdlib_module_names and name not in {package, *ELSEWHERE}
    }
    known = {name: KEYS.get(name, name) for name in foreign}
    missing = [n for n, key in known.items() if key not in named and f'python3-{n}' not in named]
    assert sorted(missing) == []


# What pip does not bring: ROS, and what comes with a requirement or where a user wants it.
ROS = re.compile(r'rclpy|launch|ament_\w+|\w+_(ros|msgs|srvs|interfaces)')
WITH_OTHERS = {'apsw', 'lz4', 'backports', 'piezo_sim'}
BY_PIP = {'yaml': 'PyYAML', 'jinja2': 'Jinja2', 'nptdms': 'npTDMS', 'serial': 'pyserial'}


def metadata(
    package: Any, monkeypatch: Any, words: tuple[Any, ...] = ('setup.py',)
) -> dict[Any, Any]:
    """Return what setup.py says of a package."""
    said = {}
    monkeypatch.chdir(SOURCES / package)
    monkeypatch.setattr('setuptools.setup', lambda **known: said.update(known))
    monkeypatch.setattr(sys, 'argv', list(words))
    runpy.run_path(str(SOURCES / package / 'setup.py'))
    return said


@pytest.mark.component
@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_pip_brings_what_a_package_imports(package: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    known = metadata(package, monkeypatch)
    required = list(known['install_requires'])
    for extra in known['extras_require'].values():
        required += extra
    names = {re.findall(r'^[\w-]+', each)[0] for each in required}
    foreign = {
        BY_PIP.get(name, name)
        for name in imported(SOURCES / package)
        if name not in sys.stdlib_module_names
        and name not in {package, *WITH_OTHERS}
        and not ROS.fullmatch(name)
    }
    assert sorted(foreign - names) == []
    assert all('<' in each or '>' in each for each in required)


def test_pip_brings_one_program_and_ros_an_executable_of_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    by_ros = metadata('piezo_hysteresis', monkeypatch)['entry_points']['console_scripts']
    by_pip = metadata('piezo_hysteresis', monkeypatch, ('setup.py', 'bdist_wheel'))
    assert by_pip['entry_points']['console_scripts'] == ['piezo = piezo_hysteresis.__main__:run']
    assert {'piezo', 'identify', 'attenuation'} <= {each.split(' =')[0] for each in by_ros}


@pytest.mark.component
@pytest.mark.parametrize('shell', ['sh', 'bash'])
def test_piezo_is_a_program_that_needs_nothing_sourced(shell: str, tmp_path: Path) -> None:
    root = SOURCES.parent
    if not (root / 'install' / 'setup.bash').is_file():
        pytest.skip('the workspace is not built: run "make setup"')
    (tmp_path / 'piezo').symlink_to(root / 'bin' / 'piezo')
    done = subprocess.run(
        [shell, '-c', './piezo --version'],
        cwd=tmp_path, env={'PATH': '/usr/bin:/bin', 'HOME': str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, '0.2.0\n'), done.stderr


def lane(**environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(ROOT / '.ci' / 'kilted')],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False,
        timeout=60.0,
    )  # fmt: skip


def test_another_python_skips_the_lane(tmp_path: Path) -> None:
    other = tmp_path / 'python3.13'
    other.write_text('#!/bin/sh\nexit 1\n')
    other.chmod(0o755)
    done = lane(PYTHON=str(other))
    assert done.returncode == 0, done.stderr
    assert done.stdout == f'kilted: skipped: {other} is not Python 3.11 or 3.12 with venv\n'


@pytest.mark.component
def test_without_the_wheels_the_lane_is_skipped(tmp_path: Path) -> None:
    done = lane(
        PYTHON=sys.executable, PIP_NO_INDEX='1', PIP_CONFIG_FILE=os.devnull,
        PIP_FIND_LINKS=str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('kilted: skipped: there is no wheel of ros-rclpy')
    assert done.stdout.count('\n') == 1


def test_the_lane_is_a_job_of_the_workflow() -> None:
    workflow = ROOT / '.github' / 'workflows' / 'ci.yml'
    assert 'run: .ci/kilted' in workflow.read_text(encoding='utf-8')
