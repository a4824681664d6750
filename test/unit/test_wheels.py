"""Wheel and sdist hold everything, and work in an environment that has only what they declare."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

from piezo_hysteresis import __version__

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ('piezo_hysteresis', 'piezo_sim')
BUILD_SDIST = 'import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])'


@dataclass(frozen=True)
class Distributions:
    """Folders with one wheel and one sdist of each package, built from a copy of the sources."""

    wheels: Path
    sdists: Path

    def wheel(self, package: str) -> Path:
        (file,) = self.wheels.glob(f'{package}-*.whl')
        return file

    def sdist(self, package: str) -> Path:
        (file,) = self.sdists.glob(f'{package}-*.tar.gz')
        return file


def pip(*words: object) -> None:
    command = [sys.executable, '-m', 'pip', '-q', '--disable-pip-version-check', '--no-input']
    done = subprocess.run(
        [*command, *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def wheel_of(source: Path, folder: Path) -> None:
    pip('wheel', '--no-index', '--no-deps', '--no-build-isolation', '-w', folder, source)


@pytest.fixture(scope='module')
def built(tmp_path_factory: pytest.TempPathFactory) -> Distributions:
    """Build in a copy: setuptools leaves folders beside the sources."""
    copy = tmp_path_factory.mktemp('copy')
    made = Distributions(copy / 'wheels', copy / 'sdists')
    shutil.copytree(ROOT / 'config', copy / 'config')
    for package in PACKAGES:
        source = copy / 'src' / package
        ignored = shutil.ignore_patterns('build', '*.egg-info', '__pycache__', '*.nb[ic]')
        shutil.copytree(ROOT / 'src' / package, source, symlinks=True, ignore=ignored)
        wheel_of(source, made.wheels)
        made.sdists.mkdir(exist_ok=True)
        command = [sys.executable, '-c', BUILD_SDIST, str(made.sdists)]
        done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return made


def names_in(archive: Path) -> set[str]:
    if archive.suffix == '.whl':
        with zipfile.ZipFile(archive) as wheel:
            return set(wheel.namelist())
    with tarfile.open(archive) as sdist:
        # a link would lead out of the archive
        return {entry.name.partition('/')[2] for entry in sdist.getmembers() if entry.isfile()}


def tracked(*patterns: str) -> set[str]:
    """Return files of the repository by their paths from its root."""
    listed = subprocess.run(
        ['git', 'ls-files', '-co', '--exclude-standard', *patterns],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}


@pytest.mark.component
def test_wheels_hold_every_file_that_the_package_reads(built: Distributions) -> None:
    for package in PACKAGES:
        held = names_in(built.wheel(package))
        source = f'src/{package}/'
        assert {each.removeprefix(source) for each in tracked(f'{source}{package}')} <= held
        (data,) = {each.partition('/')[0] for each in held if '.data/data/' in each}
        share = f'{data}/data/share'
        assert f'{share}/ament_index/resource_index/packages/{package}' in held
        assert f'{share}/{package}/package.xml' in held
    kinds = {'piezo_hysteresis': ('scenarios', 'fuzzy'), 'piezo_sim': ('presets',)}
    for package, folders in kinds.items():
        held = names_in(built.wheel(package))
        for folder in folders:
            files = tracked(f'config/{folder}')
            assert files
            assert {f'share/{package}/{each}' for each in files} <= {
                each.partition('.data/data/')[2] for each in held
            }


@pytest.mark.component
def test_an_sdist_makes_the_same_wheel(built: Distributions, tmp_path: Path) -> None:
    for package in PACKAGES:
        held = names_in(built.sdist(package))
        assert {'setup.py', 'pyproject.toml', 'package.xml', f'{package}/py.typed'} <= held
        wheel_of(built.sdist(package), tmp_path)
        (again,) = tmp_path.glob(f'{package}-*.whl')
        assert names_in(again) == names_in(built.wheel(package))


def required(names: Iterable[str]) -> Iterator[metadata.Distribution]:
    """Return the installed distributions that some require, and what these require in turn."""
    seen: set[str] = set()
    waiting = list(names)
    while waiting:
        name = re.sub(r'[-_.]+', '-', waiting.pop()).lower()
        if name in seen:
            continue
        seen.add(name)
        found = metadata.distribution(name)
        yield found
        rows = map(Requirement, found.requires or ())
        waiting += [r.name for r in rows if not r.marker or r.marker.evaluate({'extra': ''})]


def requirements_of(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (each for each in archive.namelist() if each.endswith('.dist-info/METADATA'))
        text = archive.read(name).decode()
    rows = map(Requirement, re.findall(r'(?m)^Requires-Dist: (.*)$', text))
    return [row.name for row in rows if not row.marker or row.marker.evaluate({'extra': ''})]


class Environment:
    """An environment with nothing but links to some installed distributions."""

    def __init__(self, folder: Path, distributions: Iterable[metadata.Distribution]) -> None:
        venv.create(folder, symlinks=True)
        self.python = folder / 'bin' / 'python'
        self.home = folder.parent / 'home'
        self.home.mkdir()
        (packages,) = folder.glob('lib/python*/site-packages')
        for distribution in distributions:
            for top in {file.parts[0] for file in distribution.files or ()} - {'..'}:
                link = packages / top
                if top != '__pycache__' and not link.exists():
                    link.symlink_to(Path(str(distribution.locate_file(top))).resolve())

    def run(self, *command: str) -> str:
        """Return what a program of the environment prints; nothing else can be imported there."""
        env = {'PATH': f'{self.python.parent}:/usr/bin:/bin', 'HOME': str(self.home)}
        done = subprocess.run(
            command, cwd=self.home, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture(scope='module', params=['wheel', 'sdist'])
def environment(
    request: Any, built: Distributions, tmp_path_factory: pytest.TempPathFactory
) -> Environment:
    needed = [name for p in PACKAGES for name in requirements_of(built.wheel(p))]
    needed = [name for name in needed if name.replace('-', '_') not in PACKAGES]
    tools = ['setuptools'] if request.param == 'sdist' else []
    made = Environment(tmp_path_factory.mktemp('fresh') / 'env', required([*needed, *tools]))
    files = [getattr(built, request.param)(package) for package in PACKAGES]
    words = ['--no-index', '--no-deps', '--no-build-isolation', '--no-compile']
    pip('--python', made.python, 'install', *words, *files)
    return made


@pytest.mark.slow
def test_programs_run_where_only_the_declared_is_installed(environment: Environment) -> None:
    bin_folder = environment.python.parent
    assert environment.run(str(bin_folder / 'piezo'), '--version') == f'{__version__}\n'
    assert 'sweep' in environment.run('python', '-m', 'piezo_sim', '--help')
    assert 'fdk_pzba_00030' in environment.run('python', '-m', 'piezo_sim', 'presets')
    programs = {each.name for each in bin_folder.iterdir()}
    assert not programs & {'identify', 'simulator', 'attenuation'}


PROGRAM = """
import importlib.util
import sys

import piezo_hysteresis as ph

assert not [name for name in ('numpy', 'rclpy') if name in sys.modules]
assert importlib.util.find_spec('rclpy') is None

import numpy as np

dt = 1e-3
voltage = np.sin(2 * np.pi * 5 * dt * np.arange(1000))
moved = ph.Model.from_name('classical', A1=1.2e-4).simulate(voltage, dt)
noise = 1e-8 * np.random.default_rng(0).standard_normal(voltage.size)
records = ph.load({'voltage': voltage, 'displacement': moved + noise}, dt=dt)
found = ph.identify(records, 'classical')
assert np.abs(found.simulate(voltage, dt) - moved).max() < 1e-7
assert found.report('model').is_file()
assert 'rclpy' not in sys.modules
"""


@pytest.mark.slow
def test_the_python_interface_works_without_ros(environment: Environment) -> None:
    environment.run('python', '-c', PROGRAM)
