"""The page of the nodes says what the tables say, and leaves no node out."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'nodes.md'


def test_the_page_is_up_to_date():
    done = subprocess.run(
        [sys.executable, 'tools/write_docs.py', '--check'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_every_node_has_a_section():
    text = (ROOT / 'src/piezo_hysteresis/setup.py').read_text()
    nodes = re.search(r'nodes = \[(.*?)\]', text, re.DOTALL)
    assert nodes
    names = {*re.findall(r"'(\w+)'", nodes.group(1)), 'simulator'}
    assert set(re.findall(r'^## (\w+)$', PAGE.read_text(), re.MULTILINE)) == names
