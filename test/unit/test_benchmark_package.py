"""The package of the benchmark by itself: NumPy and SciPy are enough to enter."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'studies' / 'benchmark'))
benchmark: Any = importlib.import_module('piezo_benchmark')
PAGE = ROOT / 'docs/benchmark.md'
NEEDED = ('numpy', 'numpy.libs', 'scipy', 'scipy.libs')


def test_page_and_results_are_of_this_version() -> None:
    results = json.loads(
        (ROOT / 'studies/benchmark/results/practice.json').read_text(encoding='utf-8')
    )
    assert results['version'] == benchmark.VERSION
    assert f'piezo_benchmark {benchmark.VERSION}' in PAGE.read_text(encoding='utf-8')


@pytest.mark.component
def test_the_page_is_written_from_the_results() -> None:
    report: Any = importlib.import_module('piezo_benchmark.report')
    results = json.loads(
        (ROOT / 'studies/benchmark/results/practice.json').read_text(encoding='utf-8')
    )
    folder = '../studies/benchmark'
    written = report.page(results, [], f'{folder}/pictures', f'{folder}/results/practice.md')
    assert written == PAGE.read_text('utf-8')


def example() -> str:
    """Return the entry of the page."""
    (code,) = re.findall(r'```python\n(# my_entry\.py\n.*?)```', PAGE.read_text('utf-8'), re.S)
    return str(code)


def test_the_entry_of_the_page_has_twenty_lines() -> None:
    assert len(example().splitlines()) <= 20


@pytest.mark.component
def test_the_entry_of_the_page_runs_where_only_numpy_and_scipy_are(tmp_path: Path) -> None:
    folder = tmp_path / 'empty'
    venv.create(folder, with_pip=True)
    python = folder / 'bin/python'
    (site,) = folder.glob('lib/python3*/site-packages')
    own = Path(importlib.import_module('numpy').__file__ or '').parents[1]
    for name in NEEDED:
        if (own / name).exists():
            (site / name).symlink_to(own / name)
    source = tmp_path / 'benchmark'
    subprocess.run(['cp', '-r', str(ROOT / 'studies' / 'benchmark'), str(source)], check=True)
    build = [sys.executable, '-m', 'pip', 'wheel', '-q', '--no-deps', '--no-build-isolation']
    subprocess.run([*build, '-w', str(tmp_path), str(source)], check=True, timeout=300)
    (wheel,) = tmp_path.glob('*.whl')
    install = ['-m', 'pip', 'install', '-q', '--no-index', '--no-deps', str(wheel)]
    subprocess.run([python, *install], check=True, timeout=300)
    package = tmp_path / 'my_package'
    package.mkdir()
    (package / 'my_entry.py').write_text(example(), encoding='utf-8')
    words = ['run', '--entry', 'my_package.my_entry', '--level', 'clean', '--quick']
    results = tmp_path / 'results.json'
    run = [str(python), '-m', 'piezo_benchmark', *words, '--results', str(results)]
    done = subprocess.run(
        run, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=300,
        env={'PATH': '/usr/bin:/bin'},
    )  # fmt: skip
    rows = json.loads(results.read_text(encoding='utf-8'))['entries']['my_package.my_entry']
    assert len(rows) == 6, done.stdout
    assert not [row['failed'] for row in rows if row['failed']]
    assert any(row['bits'] < 6.0 for row in rows)
