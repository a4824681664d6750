"""One name, one thing: what a newcomer looks up by its name is found in one place."""

from __future__ import annotations

import ast
from ast import Module
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2] / 'src'


def classes() -> defaultdict[str, list[tuple[str, ...]]]:
    """Return the files in which each public class is defined."""
    found = defaultdict(list)
    for path in sorted(ROOT.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                found[node.name].append(path.relative_to(ROOT).parts)
    return found


@pytest.mark.component
def test_no_class_is_called_like_another() -> None:
    assert {name: places for name, places in classes().items() if len(places) > 1} == {}


# they say nothing of what they hold
VAGUE = {'told', 'said', 'wanted', 'words'}


def variables(tree: Module) -> Iterator[str]:
    """Return the names of the variables that the functions of a module set."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    yield node.id


@pytest.mark.component
def test_no_variable_of_the_source_has_a_meaningless_name() -> None:
    found = {}
    for path in sorted(ROOT.rglob('*.py')):
        names = set(variables(ast.parse(path.read_text(encoding='utf-8')))) & VAGUE
        if names:
            found[str(path.relative_to(ROOT))] = sorted(names)
    assert found == {}


def private_uses(tree: Module) -> Any:
    """Return attributes and imports of others that begin with an underscore."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Store):
            own = isinstance(node.value, ast.Name) and node.value.id in ('self', 'cls', 'os')
            names = [] if own else [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
        else:
            continue
        yield from (n for n in names if n.startswith('_') and not n.startswith('__'))


@pytest.mark.component
def test_tests_use_what_is_public() -> None:
    of_others = {'_replace', '_asdict', '_fields', '_repr_html_'}  # tuples, notebooks
    found = {}
    for path in sorted((ROOT.parent / 'test').rglob('*.py')):
        # one slows the compiler itself down, one ends a process in the order of Python's own end
        if path.name in ('sitecustomize.py', 'fork_server.py'):
            continue
        used = set(private_uses(ast.parse(path.read_text(encoding='utf-8')))) - of_others
        if used:
            found[path.name] = sorted(used)
    assert found == {}


def test_no_test_file_is_called_like_another() -> None:
    """Pytest takes a second one for the first, and refuses to collect the whole of test/."""
    files = [path.name for path in Path(__file__).parents[1].rglob('test_*.py')]
    assert sorted(name for name in set(files) if files.count(name) > 1) == []


def test_no_module_is_called_like_another() -> None:
    """A verb may be called like the module that does what it says, ``identify``."""
    package = ROOT / 'piezo_hysteresis' / 'piezo_hysteresis'
    modules = [path for path in package.rglob('*.py') if path.stem[:2] != '__']
    names = Counter(path.stem for path in modules if path.parent.name != 'cli')
    assert [name for name, count in names.items() if count > 1] == []
