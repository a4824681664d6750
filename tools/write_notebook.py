"""Run docs/tutorials/python.ipynb and write what it prints and draws into it.

    python tools/write_notebook.py [--check]

With --check nothing is written: the exit code is 1 where a cell fails. No Jupyter is needed.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use('Agg')

from matplotlib import pyplot

NOTEBOOK = Path(__file__).resolve().parents[1] / 'docs' / 'tutorials' / 'python.ipynb'


def main() -> int:
    """Run the notebook."""
    notebook = json.loads(NOTEBOOK.read_text('utf-8'))
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        try:
            outputs = run_cells(notebook)
        except Exception:
            traceback.print_exc()
            return 1
    if '--check' not in sys.argv[1:]:
        for k, cell in enumerate(c for c in notebook['cells'] if c['cell_type'] == 'code'):
            cell['outputs'], cell['execution_count'] = outputs[k], k + 1
        young = NOTEBOOK.with_suffix(f'.{os.getpid()}.tmp')
        young.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + '\n', 'utf-8')
        young.rename(NOTEBOOK)
    return 0


def run_cells(notebook: dict[str, Any]) -> list[list[dict[str, Any]]]:
    """Return the outputs of every cell of code, run in the order in which they stand."""
    names: dict[str, Any] = {'__name__': '__main__'}
    found = []
    for k, cell in enumerate(c for c in notebook['cells'] if c['cell_type'] == 'code'):
        text = io.StringIO()
        code = compile(''.join(cell['source']), f'cell {k + 1}', 'exec')
        with contextlib.redirect_stdout(text):
            exec(code, names)  # the cells are ours
        found.append([*_printed(text.getvalue()), *_drawn()])
    return found


def _printed(text: str) -> list[dict[str, Any]]:
    lines = text.splitlines(keepends=True)
    return [{'output_type': 'stream', 'name': 'stdout', 'text': lines}] if lines else []


def _drawn() -> list[dict[str, Any]]:
    """Return the figures that a cell has left open, and close them."""
    found: list[dict[str, Any]] = []
    for number in pyplot.get_fignums():
        buffer = io.BytesIO()
        pyplot.figure(number).savefig(buffer, format='png', dpi=80, metadata={'Software': None})
        picture = base64.b64encode(buffer.getvalue()).decode()
        data = {'image/png': picture, 'text/plain': ['<Figure>']}
        found.append({'output_type': 'display_data', 'data': data, 'metadata': {}})
    pyplot.close('all')
    return found


if __name__ == '__main__':
    sys.exit(main())
