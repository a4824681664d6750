"""Public names state parameters, units and errors in sections; internal ones have one sentence."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from public_names import ROOT, Definition, definitions, exported, home, modules, public_names

pytestmark = pytest.mark.component  # parses every file of src
SECTIONS = re.compile(r'^ *(Parameters|Attributes|Returns|Yields|Raises)\n *-{3,}$', re.MULTILINE)


def sections(node: Definition) -> list[str]:
    return SECTIONS.findall(ast.get_docstring(node) or '')


def defined(parent: ast.AST, within: str = '') -> Iterator[tuple[str, Definition]]:
    """Yield every function and class by its name, those within functions as ``f.<locals>.g``."""
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield f'{within}{node.name}', node
            local = '' if isinstance(node, ast.ClassDef) else '<locals>.'
            yield from defined(node, f'{within}{node.name}.{local}')
        else:
            yield from defined(node, within)


def test_internal_names_have_no_sections() -> None:
    """Their units stand as comments in the signature: ``dt: float,  # [s]``."""
    assert [
        f'{module}.{name}'
        for module, tree in modules().items()
        for name, node in defined(tree)
        if sections(node) and (module, name) not in public_names()
    ] == []


def test_functions_of_the_python_interface_have_sections() -> None:
    places = [home('piezo_hysteresis', name) for name in exported('piezo_hysteresis')]
    nodes = [definitions(place[0])[place[1]] for place in places if place]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    assert len(functions) > 10
    assert [node.name for node in functions if 'Parameters' not in sections(node)] == []


def test_scripts_and_tests_have_no_sections() -> None:
    """The public benchmark is a package of its own."""
    assert [
        f'{path.relative_to(ROOT)}: {name}'
        for folder in ('bench', 'studies', 'tools', 'test')
        for path in (ROOT / folder).rglob('*.py')
        if 'benchmark' not in path.parts
        for name, node in defined(ast.parse(path.read_text(encoding='utf-8')))
        if sections(node)
    ] == []
