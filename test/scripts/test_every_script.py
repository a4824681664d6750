"""Each script in `bench/` and `studies/` runs with `--quick`: `make scripts`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.quick import ROOT, command_lines

FIGURE = re.compile(r'\d\.\d|\d s\b')


def docs() -> dict[Path, int]:
    return {file: file.stat().st_mtime_ns for file in (ROOT / 'docs').rglob('*.*')}


def marked(line: tuple[str, ...]) -> object:
    ros = 'NodeProcesses' in Path(line[0]).read_text(encoding='utf-8')
    name = Path(line[0]).relative_to(ROOT).with_suffix('').as_posix()
    marks = [pytest.mark.slow, *([pytest.mark.ros] if ros else [])]
    return pytest.param(line, id=' '.join((name, *line[1:])), marks=marks)


@pytest.mark.parametrize('line', [marked(each) for each in command_lines()])
def test_a_script_runs_small_and_prints_a_figure(line: tuple[str, ...]) -> None:
    before = docs()
    done = subprocess.run(
        [sys.executable, *line, '--quick'],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=300.0,
    )  # fmt: skip  # s, on a busy machine
    assert done.returncode == 0, done.stderr
    assert FIGURE.search(done.stdout), done.stdout
    assert docs() == before
