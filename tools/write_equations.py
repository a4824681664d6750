"""Write docs/equations.md: the code of each equation of the papers, from tags in docstrings.

A tag is the short name of a paper and numbers behind it, as in ``Fujii 2018 (16), (17)``; it
counts for the module, class or function in whose docstring, or in whose `source`, it stands.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from equations import EQUATIONS

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'equations.md'
_SHOWN = 2
_WORDS = '|'.join(label for each in EQUATIONS.values() for label in each if not label.isdigit())
_LABEL = rf'\((?:\d+|{_WORDS})\)'
_TAG = re.compile(rf'({"|".join(EQUATIONS)})\s+({_LABEL}(?:(?:-|, | and |, and ){_LABEL})*)')

HEAD = """# Equations of the papers: code, command, figures

The tables list each numbered equation of the five papers, the code that implements it, a command
that uses it, and the figures that depend on it. Commands are verbs of `piezo`; `piezo_sim` is
`python -m piezo_sim`. [papers.md](papers.md) shows the figures.
`python tools/write_docs.py` writes this page from tags in docstrings.
"""
_FANG = (
    'The equations of Fang 2019 are images that are missing from its text, which refers to (9) '
    'only. The others have no number here and are reconstructed from the description.'
)


def places() -> dict[tuple[str, str], list[str]]:
    """Return for each paper and equation where it is tagged, the most specific places first."""
    found: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for module, path in modules():
        for rank, name, text in _texts(ast.parse(path.read_text(encoding='utf-8'))):
            # the world is not the code that a paper describes, and a page only repeats it
            later = 10 * module.startswith(('piezo_sim', 'studies'))
            later += 5 * (
                '.nodes.' in module or '.parameters.' in module or '.discovery.' in module
            )
            for tag in tags(text):
                place = f'{module}:{name}' if name else module
                found.setdefault(tag, []).append((rank + later, place))
    return {tag: list(dict.fromkeys(p for _, p in sorted(rows))) for tag, rows in found.items()}


def modules() -> Iterator[tuple[str, Path]]:
    """Yield name and file of each module of the packages and of the figures of the papers."""
    for path in sorted((ROOT / 'src').glob('*/*/**/*.py')):
        yield _name(path.relative_to(ROOT / 'src').parts[1:]), path
    for path in sorted((ROOT / 'studies' / 'papers').glob('*.py')):
        yield _name(path.relative_to(ROOT).parts), path


def _name(parts: tuple[str, ...]) -> str:
    return '.'.join(parts).removesuffix('.py').removesuffix('.__init__')


def tags(text: str) -> Iterator[tuple[str, str]]:
    """Yield paper and label of each equation that a text names, ranges written out."""
    for paper, labels in _TAG.findall(' '.join(text.split())):
        parts = re.split(r'(-|, and |, | and )', labels)
        before = ''
        for place in range(0, len(parts), 2):
            label = parts[place].strip('()')
            if place and parts[place - 1] == '-' and before.isdigit() and label.isdigit():
                yield from ((paper, str(k)) for k in range(int(before) + 1, int(label)))
            before = label
            yield paper, label


def _texts(tree: ast.Module) -> Iterator[tuple[int, str, str]]:
    """Yield rank, name and text: docstrings, and what an assignment says of its source."""
    yield 3, '', ast.get_docstring(tree) or ''
    yield from _docstrings(tree, '')
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            strings = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
            for text in strings:
                if isinstance(text, str):
                    yield 1, ast.unparse(target), text


def _docstrings(parent: ast.Module | ast.ClassDef, within: str) -> Iterator[tuple[int, str, str]]:
    for node in parent.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield 0, within + node.name, ast.get_docstring(node) or ''
        if isinstance(node, ast.ClassDef):
            yield from _docstrings(node, f'{within}{node.name}.')


def page() -> str:
    """Return the page."""
    where = places()
    lines = [HEAD]
    for paper, equations in EQUATIONS.items():
        lines += [f'## {paper}', '']
        if paper == 'Fang 2019':
            lines += [_FANG, '']
        lines += ['| equation | subject | code | command | figures |', '|---|---|---|---|---|']
        for label, each in equations.items():
            code = ', '.join(f'`{place}`' for place in where.get((paper, label), [])[:_SHOWN])
            command = f'`{each.command}`' if each.command else ''
            name = f'({label})' if label.isdigit() else label
            lines.append(f'| {name} | {each.about} | {code} | {command} | {each.figures} |')
        lines.append('')
    return '\n'.join(lines)


def equation_pages() -> dict[Path, str]:
    """Return the page by its path."""
    return {PAGE: page()}
