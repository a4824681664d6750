"""Run docs/tutorials/python.ipynb and write what it prints and draws into it.

    python tools/write_notebook.py [--check]

With --check nothing is written: the exit code is 1 where a cell fails. No Jupyter is needed: the
cells run as one program, in a folder of their own.
"""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).resolve().parents[1] / 'docs' / 'tutorials' / 'python.ipynb'
# Stands in the output between two cells.
MARK = '\x1e'

_BEGIN = """
import matplotlib
matplotlib.use('Agg')

def _end_of_cell(number):
    import matplotlib.pyplot as plot
    for count, each in enumerate(plot.get_fignums()):
        name = f'cell_{number}_{count}.png'
        plot.figure(each).savefig(name, format='png', dpi=80, metadata={'Software': None})
    plot.close('all')
    print(end=chr(30), flush=True)

"""


def main() -> int:
    """Run the notebook."""
    notebook = json.loads(NOTEBOOK.read_text('utf-8'))
    cells = [cell for cell in notebook['cells'] if cell['cell_type'] == 'code']
    with tempfile.TemporaryDirectory() as folder:
        outputs = run_cells([''.join(cell['source']) for cell in cells], Path(folder))
    if outputs is None:
        return 1
    if '--check' not in sys.argv[1:]:
        for k, cell in enumerate(cells):
            cell['outputs'], cell['execution_count'] = outputs[k], k + 1
        temporary = NOTEBOOK.with_suffix(f'.{os.getpid()}.tmp')
        temporary.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + '\n', 'utf-8')
        temporary.rename(NOTEBOOK)
    return 0


def run_cells(cells: list[str], folder: Path) -> list[list[dict[str, Any]]] | None:
    """Return the outputs of every cell, run in a folder in the order in which they stand."""
    parts = [f'{cell}\n_end_of_cell({k})\n' for k, cell in enumerate(cells)]
    program = folder / 'cells.py'
    program.write_text(_BEGIN + '\n'.join(parts), 'utf-8')
    # what the commands in a cell print belongs to the cell: all of it in the order of its coming
    command = [sys.executable, '-u', program.name]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return None
    printed = done.stdout.split(MARK)
    return [[*_printed(printed[k]), *_drawn(folder, k)] for k in range(len(cells))]


def _printed(text: str) -> list[dict[str, Any]]:
    lines = text.splitlines(keepends=True)
    return [{'output_type': 'stream', 'name': 'stdout', 'text': lines}] if lines else []


def _drawn(folder: Path, cell: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    for file in sorted(folder.glob(f'cell_{cell}_*.png')):
        picture = base64.b64encode(file.read_bytes()).decode()
        data = {'image/png': picture, 'text/plain': ['<Figure>']}
        found.append({'output_type': 'display_data', 'data': data, 'metadata': {}})
    return found


if __name__ == '__main__':
    sys.exit(main())
