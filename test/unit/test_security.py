"""What keeps others out, as far as the source and the policy say: no node is started."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    file
    for folder in ('src', 'tools', 'bench', 'studies')
    for file in sorted((ROOT / folder).rglob('*.py'))
]
POLICY = ROOT / 'config' / 'security' / 'policy.xml'

# Calls that would run what a file or a message says.
FORBIDDEN = {'eval', 'exec', 'compile', '__import__', 'os.system', 'os.popen'}
UNSAFE_MODULES = {'pickle', 'cPickle', 'dill', 'shelve', 'marshal', 'joblib', 'cloudpickle'}
UNSAFE_YAML = {
    'load', 'load_all', 'unsafe_load', 'unsafe_load_all', 'full_load', 'full_load_all',
    'Loader', 'UnsafeLoader', 'FullLoader', 'CLoader', 'CFullLoader', 'CUnsafeLoader',
}  # fmt: skip


# The one loader of our own makes nothing that the safe one does not.
SAFE_LOADER = 'class _Loader(yaml.SafeLoader):'


def offences(source: str) -> Iterator[str]:
    """Yield everything in `source` that would trust data with code."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = getattr(node, 'module', None)
            names = [module] if module else [alias.name for alias in node.names]
            yield from (name for name in names if name.split('.')[0] in UNSAFE_MODULES)
            if module == 'yaml':
                yield from (alias.name for alias in node.names if alias.name in UNSAFE_YAML)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == 'yaml':
            if node.attr in UNSAFE_YAML and not (node.attr == 'load' and SAFE_LOADER in source):
                yield f'yaml.{node.attr}'
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name in FORBIDDEN:
                yield name
            for word in node.keywords:
                if word.arg in ('shell', 'allow_pickle') and not _false(word.value):
                    yield f'{name}({word.arg}=...)'


def _false(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is False


@pytest.mark.component
def test_nothing_trusts_data_with_code() -> None:
    found = {
        str(file.relative_to(ROOT)): found
        for file in SOURCES
        if (found := sorted(set(offences(file.read_text(encoding='utf-8')))))
    }
    # derivatives of kernels are written from the source of these very kernels
    compiler = 'src/piezo_hysteresis/piezo_hysteresis/kernels/compile.py'
    assert found == {compiler: ['compile', 'exec']}


@pytest.mark.parametrize(
    'source',
    [
        'import pickle',
        'from joblib import load',
        'import yaml\nyaml.load(text, Loader=yaml.Loader)',
        'from yaml import unsafe_load',
        'eval(text)',
        'subprocess.run(text, shell=True)',
        'numpy.load(file, allow_pickle=True)',
    ],
)
def test_trust_is_found(source: str) -> None:
    assert list(offences(source))


def test_harmless_code_is_left_alone() -> None:
    assert not list(
        offences('import yaml\nyaml.safe_load(text)\nre.compile(text)\nf(shell=False)')
    )


# --- who may say what ---------------------------------------------------------------------------


def profiles() -> dict[str, Xml.Element]:
    """Return the profile of every enclave of the policy, by the name of the node."""
    root = Xml.parse(POLICY).getroot()
    return {profile.attrib['node']: profile for profile in root.iter('profile')}


def allowed(profile: Xml.Element, kind: str, rule: str) -> set[str]:
    groups = [group for group in profile.findall(f'{kind}s') if group.get(rule) == 'ALLOW']
    return {str(each.text) for group in groups for each in group}


@pytest.mark.component
def test_the_policy_is_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, 'tools/write_policy.py', '--check'], cwd=ROOT, check=False
    )
    assert done.returncode == 0, 'run: python tools/write_policy.py'


def test_only_links_and_excitation_move_the_actuator() -> None:
    may = {
        name
        for name, p in profiles().items()
        if 'voltage/command' in allowed(p, 'topic', 'publish')
    }
    assert may == {'excitation', 'attenuation', 'feedback', 'control_loop'}


def test_people_publish_nothing_of_the_loop_and_observers_call_nothing() -> None:
    found = profiles()
    for person in ('operator', 'observer', 'dashboard'):
        topics = allowed(found[person], 'topic', 'publish')
        # The page says what it has recorded, and nothing that a link of the loop acts on.
        own = {'dashboard_recorder/status'} if person == 'dashboard' else set()
        assert all(name.startswith('/') for name in topics - own)
        assert 'actuator/state' in allowed(found[person], 'topic', 'subscribe')
    assert not allowed(found['observer'], 'service', 'request')
    assert not allowed(found['observer'], 'action', 'call')
    assert 'excitation/set_parameters' in allowed(found['operator'], 'service', 'request')
    assert 'run_sweep' in allowed(found['operator'], 'action', 'call')


@pytest.mark.component
def test_the_policy_of_another_namespace_is_written(tmp_path: Path) -> None:
    out = tmp_path / 'policy.xml'
    words = ['tools/write_policy.py', '--namespace', '/stage_x/', '--out', str(out)]
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True)
    enclaves = [e.attrib['path'] for e in Xml.parse(out).getroot().iter('enclave')]
    assert '/stage_x/feedforward' in enclaves
    assert all(path.startswith('/stage_x/') for path in enclaves)


# --- this machine only --------------------------------------------------------------------------


def test_tests_and_demo_stay_on_this_machine() -> None:
    assert 'export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST' in (ROOT / 'Makefile').read_text()
    processes = (ROOT / 'src/piezo_hysteresis/piezo_hysteresis/ros/processes.py').read_text()
    assert "'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'" in processes
