"""The page of the nodes agrees with the tables and lists every node."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from piezo_hysteresis.common.registry import NODES

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'nodes.md'


@pytest.mark.component
def test_the_page_is_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, 'tools/write_docs.py', '--check'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_every_node_has_a_section() -> None:
    assert set(re.findall(r'^## (\w+)$', PAGE.read_text(), re.MULTILINE)) == set(NODES)


@pytest.mark.parametrize('launch', ['loop', 'record', 'stages'])
def test_every_launch_argument_is_documented(launch: str) -> None:
    source = (ROOT / f'src/piezo_hysteresis/launch/{launch}.launch.py').read_text()
    values = next(
        node.value
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'ARGUMENTS'
    )
    arguments = ast.literal_eval(values)
    page = (ROOT / 'docs/launch.md').read_text()
    for name, (default, _) in arguments.items():
        assert f'`{name}`' in page
        if launch == 'loop' and default:
            assert f'| `{name}` | `{default}` |' in page
