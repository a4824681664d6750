"""Access control, as far as the source shows it: no node is started."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    file
    for folder in ('src', 'tools', 'bench', 'studies')
    for file in sorted((ROOT / folder).rglob('*.py'))
]

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
def test_no_data_are_loaded_as_code() -> None:
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


def test_harmless_code_is_accepted() -> None:
    assert not list(
        offences('import yaml\nyaml.safe_load(text)\nre.compile(text)\nf(shell=False)')
    )


# --- this machine only --------------------------------------------------------------------------


def test_tests_and_demo_stay_on_this_machine() -> None:
    assert 'export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST' in (ROOT / 'Makefile').read_text()
    processes = (ROOT / 'src/piezo_hysteresis/piezo_hysteresis/ros/processes.py').read_text()
    assert "'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'" in processes
