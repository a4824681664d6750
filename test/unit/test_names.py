"""One name, one thing: what a newcomer looks up by its name is found in one place."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2] / 'src'


def classes():
    """Return the files in which each public class is defined."""
    found = defaultdict(list)
    for path in sorted(ROOT.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                found[node.name].append(path.relative_to(ROOT).parts)
    return found


def test_no_class_is_called_like_another():
    assert {name: places for name, places in classes().items() if len(places) > 1} == {}
