"""The stubs that mypy reads say what the generated classes are, and mypy refuses other fields."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('piezo_interfaces', reason='the workspace is not built: run "make setup"')

ROOT = Path(__file__).resolve().parents[2]
STUBS = ROOT / 'tools' / 'stubs'
MODULES = sorted(path for path in STUBS.rglob('*.pyi') if path.stem != '__init__')
# What holds a value of each type; an array of NumPy where the message has a fixed size.
HOLDS = {'Sequence': 'list', 'NDArray': 'ndarray'}


def test_the_stubs_are_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, 'tools/write_stubs.py', '--check'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def messages_of(module: Any, body: list[ast.stmt]) -> Iterator[tuple[Any, ast.ClassDef]]:
    """Yield each class with fields, and what its stub says."""
    for stub in body:
        if isinstance(stub, ast.ClassDef):
            kind = getattr(module, stub.name)
            if hasattr(kind, 'get_fields_and_field_types'):
                yield kind, stub
            else:  # a service or an action
                yield from messages_of(kind, stub.body)


def types_of(stub: ast.ClassDef) -> Iterator[tuple[str, str]]:
    """Yield the name of each field and constant, and the type that its stub gives it."""
    for line in stub.body:
        if isinstance(line, ast.AnnAssign):
            yield ast.unparse(line.target), ast.unparse(line.annotation)
        elif isinstance(line, ast.FunctionDef) and 'property' in map(
            ast.unparse, line.decorator_list
        ):
            yield line.name, ast.unparse(line.returns or line)


@pytest.mark.parametrize('path', MODULES, ids=lambda path: f'{path.parent.name}.{path.stem}')
def test_stubs_agree_with_the_classes(path: Path) -> None:
    module = importlib.import_module(f'{path.parent.name}.{path.stem}')
    found = list(messages_of(module, ast.parse(path.read_text(encoding='utf-8')).body))
    assert found
    for kind, stub in found:
        types = dict(types_of(stub))
        fields = {name for name, words in types.items() if not words.startswith('ClassVar')}
        assert fields == kind.get_fields_and_field_types().keys()
        message = kind(**{name: getattr(kind(), name) for name in fields})
        for name, words in types.items():
            held = words.removeprefix('ClassVar[').rstrip(']').split('[')[0].split('.')[-1]
            assert type(getattr(message, name)).__name__ == HOLDS.get(held, held), name


USE = """
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import LoopStatus

status = LoopStatus(names=['overruns'], counts=[1])
dict(zip(status.names, status.counts, strict=True))
RunSweep.Goal(frequencies=[1.0], amplitudes=(2.0,)).frequencies.append(3.0)
"""
WRONG = {
    'status.nmaes': 'has no attribute "nmaes"',
    "status.names.split(',')": 'has no attribute "split"',
    "status.names = 'overruns'": 'Incompatible types in assignment',
    'status.sample = 1.5': 'Incompatible types in assignment',
    'LoopStatus(nmaes=[])': 'Unexpected keyword argument "nmaes"',
    'RunSweep.Feedback().frequencies': 'has no attribute "frequencies"',
}


@pytest.mark.component
def test_mypy_refuses_a_field_that_is_not_there(tmp_path: Path) -> None:
    """Every wrong line is refused, and nothing else is."""
    program = tmp_path / 'program.py'
    program.write_text(USE + '\n'.join(WRONG) + '\n')
    done = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', '--config-file=', 'program.py'],
        cwd=tmp_path,
        env={'MYPYPATH': str(STUBS), 'MYPY_CACHE_DIR': str(tmp_path / 'cache')},
        capture_output=True,
        text=True,
        check=False,
    )
    refused = [line for line in done.stdout.splitlines() if ': error: ' in line]
    assert len(refused) == len(WRONG), done.stdout + done.stderr
    for line, why in zip(refused, WRONG.values(), strict=True):
        assert why in line


FOLDER = Path(__file__).parents[2] / 'src' / 'piezo_interfaces'
FILES = sorted(path for kind in ('msg', 'srv', 'action') for path in FOLDER.glob(f'{kind}/*'))
FIELD = re.compile(r'^(?P<kind>\w+(/\w+)?(\[\])?) +(?P<name>\w+) *(#(?P<words>.*))?$')
NUMBERS = ('float', 'int', 'uint')


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_field_has_a_sentence_and_every_number_a_unit(path: Path) -> None:
    lines = path.read_text(encoding='utf-8').splitlines()
    assert lines[0].startswith('# ')
    fields = [FIELD.match(line) for line in lines if line[:1] not in ('#', '-', '')]
    assert all(fields)
    for field in fields:
        if field is None or field['kind'] == 'std_msgs/Header':
            continue
        words = field['words'] or ''
        assert words.strip(), f'{field["name"]} says nothing'
        if field['kind'].startswith(NUMBERS):
            assert re.search(r'\[[\w/^() ]+\]|in its unit', words), f'{field["name"]}: no unit'
