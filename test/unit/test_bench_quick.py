"""Each script in `bench/` and `studies/` explains itself and runs with `--quick`."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.quick import parsed
from studies.study import WORLDS

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = [
    path
    for folder in ('bench', 'studies', 'studies/papers')
    for path in sorted((ROOT / folder).glob('*.py'))
    if '__main__' in path.read_text(encoding='utf-8')
]
FIGURE = re.compile(r'\d\.\d|\d s\b')


def run(script: Path, *words: str, limit: float) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(script), *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=limit,
    )


def docs() -> dict[Path, int]:
    return {file: file.stat().st_mtime_ns for file in (ROOT / 'docs').rglob('*.*')}


def parameters(script: Path) -> list[object]:
    ros = 'NodeProcesses' in script.read_text(encoding='utf-8')
    marks = [pytest.mark.slow, *([pytest.mark.ros] if ros else [])]
    name = f'{script.parent.name}/{script.stem}'
    if script.stem == 'study':
        return [pytest.param(script, (w,), id=f'{name} {w}', marks=marks) for w in WORLDS]
    return [pytest.param(script, (), id=name, marks=marks)]


def test_there_are_scripts_of_both_kinds() -> None:
    assert {script.parent.name for script in SCRIPTS} == {'bench', 'studies', 'papers'}
    assert {'real_time', 'study', 'fujii2018'} <= {script.stem for script in SCRIPTS}


@pytest.mark.parametrize(
    ('script', 'words'), [p for script in SCRIPTS for p in parameters(script)]
)
def test_a_script_runs_small_and_prints_a_figure(script: Path, words: tuple[str, ...]) -> None:
    helped = run(script, *words, '--help', limit=30.0)
    assert helped.returncode == 0, helped.stderr
    assert '--quick' in helped.stdout
    before = docs()
    done = run(script, *words, '--quick', limit=300.0)  # s, on a busy machine
    assert done.returncode == 0, done.stderr
    assert FIGURE.search(done.stdout), done.stdout
    assert docs() == before


def parser(out: str = 'out/found.json') -> argparse.ArgumentParser:
    made = argparse.ArgumentParser()
    made.add_argument('--sets', type=int, default=100)
    made.add_argument('--page', type=Path)
    made.add_argument('--out', type=Path, default=Path(out))
    return made


def test_a_quick_run_has_small_numbers_and_leaves_nothing_in_out() -> None:
    assert parsed(parser(), [], sets=1).sets == 100
    quick = parsed(parser(), ['--quick'], sets=1)
    assert quick.sets == 1
    assert quick.out.name == 'found.json'
    assert quick.out.parent.is_dir()
    assert not quick.out.is_relative_to('out')


def test_what_is_given_wins_over_the_small_numbers() -> None:
    asked = parsed(parser(), ['--quick', '--sets', '7', '--out', 'mine.json'], sets=1)
    assert (asked.sets, asked.out) == (7, Path('mine.json'))


def test_a_quick_run_writes_no_page(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed(parser(), ['--quick', '--page', 'docs/page.md'], sets=1)
    assert 'writes no page: leave out --page' in capsys.readouterr().err
