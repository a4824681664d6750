"""Names that users see: the reference pages, `piezo_hysteresis` and what its results offer."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))

from write_reference import SECTIONS  # noqa: E402 - from tools

PACKAGES = (ROOT / 'src' / 'piezo_hysteresis', ROOT / 'src' / 'piezo_sim')
# Packages of which everything that they export is public.
EXPORTING = (
    'piezo_hysteresis',
    'piezo_sim',
    'piezo_hysteresis.blocks.effect',
    'piezo_hysteresis.blocks.base',
)
# Results whose fields are of public classes, too.
RESULTS = ('Discovery', 'Verdict', 'NamedEffect', 'Validation', 'Compensation', 'Identification')
Definition = ast.FunctionDef | ast.ClassDef
Name = tuple[str, str]  # module, and the name in it: 'Class.method'
IMPORT = re.compile(r'from (piezo[\w.]+) import ([\w, ]+)')


@cache
def modules() -> dict[str, ast.Module]:
    """Return the syntax trees of both packages by the name of the module."""
    found = {}
    for folder in PACKAGES:
        for path in sorted(folder.rglob('*.py')):
            parts = path.relative_to(folder).with_suffix('').parts
            name = '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)
            found[name] = ast.parse(path.read_text(encoding='utf-8'))
    return found


@cache
def definitions(module: str) -> dict[str, Definition]:
    """Return functions and classes of a module, and the methods of its classes."""
    found: dict[str, Definition] = {}
    for node in ast.walk(modules()[module]):
        if isinstance(node, ast.ClassDef):
            methods = [each for each in node.body if isinstance(each, ast.FunctionDef)]
            found.update({f'{node.name}.{each.name}': each for each in methods})
    found.update(
        {
            n.name: n
            for n in modules()[module].body
            if isinstance(n, ast.FunctionDef | ast.ClassDef)
        }
    )
    return found


@cache
def imports(module: str) -> dict[str, Name]:
    """Return where the imported names of a module come from."""
    return {
        alias.asname or alias.name: (node.module or '', alias.name)
        for node in ast.walk(modules()[module])
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def home(module: str, name: str) -> Name | None:
    """Return where a name of a module is defined; None if not in these packages."""
    while module in modules():
        if name in definitions(module):
            return module, name
        if name not in imports(module):
            return None
        module, name = imports(module)[name]
    return None


def exported(module: str) -> list[str]:
    """Return the names in ``__all__``, else what the module defines without an underscore."""
    for node in modules()[module].body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == '__all__':
            return list(ast.literal_eval(node.value))
    return [name for name in definitions(module) if not name.startswith('_')]


def annotated(module: str, annotation: ast.expr | None) -> Iterator[Name]:
    """Yield the classes of these packages that an annotation names."""
    for node in ast.walk(annotation) if annotation else ():
        if isinstance(node, ast.Name) and (found := home(module, node.id)):
            yield found


def reached(name: Name) -> Iterator[Name]:
    """Yield what a public name offers: methods, classes of fields, of results and of bases."""
    module, whole = name
    node = definitions(module)[whole]
    if isinstance(node, ast.FunctionDef):
        yield from annotated(module, node.returns)
        return
    for base in node.bases:
        yield from annotated(module, base)
    for each in node.body:
        if isinstance(each, ast.FunctionDef) and not each.name.startswith('_'):
            yield module, f'{whole}.{each.name}'
        elif isinstance(each, ast.AnnAssign) and whole in RESULTS:
            yield from annotated(module, each.annotation)


def roots() -> Iterator[Name]:
    """Yield what pages, packages and the imports in pages name, and the nodes."""
    for module in (
        *(f'piezo_hysteresis.{name}' for _, names in SECTIONS.values() for name in names),
        *EXPORTING,
    ):
        yield from (found for name in exported(module) if (found := home(module, name)))
    for page in (ROOT / 'docs').rglob('*.md'):
        for module, names in IMPORT.findall(page.read_text(encoding='utf-8')):
            for name in names.split(','):
                if found := home(module, name.strip()):
                    yield found
    for module in modules():
        if '.nodes.' in module:
            for name, node in definitions(module).items():
                if isinstance(node, ast.ClassDef) and any(
                    ast.unparse(base).endswith('Node') for base in node.bases
                ):
                    yield module, name


@cache
def public_names() -> frozenset[Name]:
    """Return the public functions, classes and methods."""
    found, todo = set(), list(roots())
    while todo:
        if (name := todo.pop()) not in found:
            found.add(name)
            if not re.search(r'\.nodes\.', name[0]):
                todo += reached(name)
    return frozenset(found)
