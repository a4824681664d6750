"""Each script in `bench/` and `studies/` explains itself; `--quick` makes it small."""

from __future__ import annotations

import argparse
import runpy
import sys
from pathlib import Path

import pytest

from bench.quick import command_lines, parsed

LINES = command_lines()


def test_there_are_scripts_of_both_kinds() -> None:
    scripts = [Path(line[0]) for line in LINES]
    assert {script.parent.name for script in scripts} == {'bench', 'studies', 'papers'}
    assert {'real_time', 'study', 'fujii2018'} <= {script.stem for script in scripts}


@pytest.mark.component
@pytest.mark.parametrize('line', LINES, ids=lambda line: '_'.join(Path(w).stem for w in line))
def test_a_script_explains_itself_and_its_quick_run(
    line: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if 'NodeProcesses' in Path(line[0]).read_text(encoding='utf-8'):
        pytest.importorskip('rclpy')
    monkeypatch.setattr(sys, 'argv', [*line, '--help'])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(line[0], run_name='__main__')
    assert not end.value.code
    assert '--quick' in capsys.readouterr().out


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
