"""The suite does not import the benchmark, and the benchmark nothing of the suite."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ALLOWED = {'numpy', 'scipy', 'piezo_benchmark'}
PEERS = {'pysindy', 'sysidentpy'}


def imported(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split('.')[0])
    return found


def test_nothing_of_the_suite_imports_the_benchmark() -> None:
    files = [
        p
        for folder in ('src', 'studies', 'bench', 'tools')
        for p in (ROOT / folder).rglob('*.py')
        if not p.is_relative_to(ROOT / 'studies' / 'benchmark')
    ]
    assert files
    texts = {p: p.read_text(encoding='utf-8') for p in files}
    assert not [
        p
        for p, text in texts.items()
        if 'piezo_benchmark' in text and 'piezo_benchmark' in imported(p)
    ]


def test_the_benchmark_imports_numpy_and_scipy_only() -> None:
    files = sorted((ROOT / 'studies' / 'benchmark').rglob('*.py'))
    assert len(files) > 10
    for file in files:
        more = PEERS if file.parent.name == 'entries' else set()
        more = more | ({'matplotlib'} if file.name == 'report.py' else set())
        assert imported(file) <= ALLOWED | sys.stdlib_module_names | more, file.name
