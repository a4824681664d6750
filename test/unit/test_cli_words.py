"""What every command line has in common: near names, errors of one line, -q and -v, plurals."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.main import main, parser_of
from piezo_hysteresis.common.wording import OneLineParser, counted, near
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, write_bag
from piezo_sim.cli import build_parser
from piezo_sim.cli import main as simulate

SOURCES = Path(__file__).parents[2] / 'src'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a folder, entered, with the bag `one`."""
    time = np.arange(2000) * 1e-3
    voltage = np.sin(2 * np.pi * 5.0 * time)
    noise = 1e-8 * np.random.default_rng(0).standard_normal(time.size)
    write_bag(tmp_path / 'one', [Record('a', 1e-3, voltage, 1e-4 * voltage + noise)])
    model = named('classical')
    ModelFile(model, model.defaults()).save(tmp_path / 'model.yaml')
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    verbosity.choose(verbosity.parsed([]))


def refused(words: str, capsys: Any, program: Any = main) -> str:
    """Return the one line with which a command line is refused."""
    try:
        code = program(words.split())
    except SystemExit as ended:
        code = ended.code
    said = capsys.readouterr()
    assert code == 2
    assert said.out == ''
    (line,) = said.err.strip().splitlines()
    assert line.startswith('error: ')
    return str(line)


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ('identfy one', 'no verb identfy (did you mean identify?)'),
        ('identify one --model bouc_wen_modes --out o', '(did you mean bouc_wen_mode?)'),
        ('identify one --model classical+crep --out o', '(did you mean creep?)'),
        ('identify one --model classical --set bta=1 --out o', '(did you mean beta?)'),
        ('identify one --model classical --method psoo --out o', '(did you mean pso?)'),
        ('identify one --model classical --strat rest --out o', '(did you mean --start?)'),
        ('identify one --model classical --start rset --out o', '(did you mean rest?)'),
        ('identify one --model classical', '--out DIR is missing'),
        ('identify one --modl classical', '(did you mean --model?)'),
        ('discover one --baseline modle.yaml --out o', '(did you mean model.yaml?)'),
        ('discover one --baseline classical --out o --policy min_shar=1', 'mean min_share?)'),
        ('compensate --model model.yaml --plant model.yaml --reference sin:frequency=5 --out o',
         'no waveform sin (did you mean sine?)'),
        ('node attenution', 'no node attenution (did you mean attenuation?)'),
        ('export one --rate 20000 --out o', '--rate belongs to the export of a MODEL.yaml'),
        ('export one --together --out o', '--together belongs to the export of a MODEL.yaml'),
        ('export model.yaml --unit m --out o', '--unit belongs to the export of records'),
        ('-q -v info one', 'not allowed with'),
    ],
)  # fmt: skip
def test_a_slip_is_one_line_that_helps(
    words: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(words, capsys)
    assert not (folder / 'o').exists()


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ('swep', '(did you mean sweep?)'),
        ('sweep --frequencies 5', '--out is missing'),
        ('sweep --waveform sin --out o', '(did you mean sine?)'),
        ('sweep --preset fang --out o', '(did you mean fang_p845_stage?)'),
        ('sweep --set effects.crep=true --out o', '(did you mean effects.creep?)'),
    ],
)
def test_the_simulator_helps_as_well(
    words: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(words, capsys, simulate)
    assert not (folder / 'o').exists()


@pytest.mark.parametrize('words', ['-q info one', 'info one -q', '--quiet info one'])
def test_quiet_stands_before_the_verb_or_behind_it(
    words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 0
    assert verbosity.level() == verbosity.Verbosity.QUIET
    assert main(['-v', 'info', 'one']) == 0
    assert verbosity.level() == verbosity.Verbosity.VERBOSE


@pytest.mark.slow
def test_a_verb_reports_that_it_replaces_its_own_results(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['validate', 'one', '--model', 'model.yaml', '--out', 'checked']
    assert main(words) == 0
    assert 'replaced' not in capsys.readouterr().err
    assert main(words) == 0
    note = 'note: checked: the results of an earlier validate are replaced'
    assert note in capsys.readouterr().err.splitlines()


def test_one_is_no_plural(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert simulate(['sweep', '--frequencies', '5', '--seconds', '1', '--out', 'b', '-q']) == 0
    said = capsys.readouterr()
    assert said.out.startswith('b: 1 record, 1000 samples')
    assert said.err == ''
    assert main(['export', 'b', '--out', 'c']) == 0
    assert '1 file in c' in capsys.readouterr().out
    assert [counted(n, 'record') for n in (0, 1, 2)] == ['0 records', '1 record', '2 records']
    assert [counted(n, 'axis', 'is') for n in (1, 2)] == ['1 axis is', '2 axes are']
    assert [counted(n, 'line', 'comes') for n in (1, 2)] == ['1 line comes', '2 lines come']


_NOUNS = 'ax[ei]s|cells|columns|data sets|lines|messages|modes|periods|records|samples|times'


def test_no_sentence_gives_a_count_a_fixed_plural() -> None:
    """``1 lines are``: a count goes through `counted`, except behind ``of``."""
    fixed = re.compile(rf'(?<! of )\{{(len\([^{{}}]*\)|[\w.]*\.size|[\w.]+\.axes)\}} ({_NOUNS})\b')
    found = [
        f'{file.name}: {match[0]}'
        for file in sorted(SOURCES.rglob('*.py'))
        for match in fixed.finditer(file.read_text(encoding='utf-8'))
    ]
    assert found == []


@pytest.mark.parametrize('low', ['-50', '-5e1', '-.5E+2', '-5.e1'])
def test_a_negative_number_is_no_option(low: str) -> None:
    """The library knows no exponent; a verb and the simulator take it, alone and in a list."""
    words = ['model.yaml', '--out', 'o', '--limits', low, '150', '1e6', '--energy', '1', low, low]
    given = parser_of('export').parse_args(words)
    assert given.limits == [float(low), 150.0, 1e6]
    assert given.energy == [1.0, float(low), float(low)]
    sweep = ['sweep', '--out', 'o', '--frequencies', '5', '--amplitudes', f'{low},{low}']
    assert build_parser().parse_args(sweep).amplitudes == [float(low)] * 2


def test_only_what_is_near_is_suggested() -> None:
    known = ('feedforward', 'feedback', 'attenuation')
    assert near('Attenuation', known) == ' (did you mean attenuation?)'
    assert near('xyz', known) == near('', known) == near('fee', known) == ''
    assert near('-q', ['-q']) == ''  # of another verb: no other name is meant


def test_values_and_words_of_others_are_no_slips() -> None:
    parser = OneLineParser(prog='x')
    parser.add_argument('--low', type=float)
    assert parser.parse_args(['--low', '-1']).low == -1.0
    assert parser.parse_args(['--lo=-1']).low == -1.0


@pytest.mark.component
def test_a_reader_that_has_seen_enough_is_no_error(folder: Path) -> None:
    command = (
        f'{sys.executable} -m piezo_hysteresis identify --help | true; echo ${{PIPESTATUS[0]}}'
    )
    done = subprocess.run(['bash', '-c', command], capture_output=True, text=True, check=True)
    assert done.stdout == '0\n'
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(
    'words',
    ['--help', *(f'{verb} --help' for verb in ('param', 'identify', 'discover', 'validate'))],
)
def test_help_imports_neither_arrays_nor_a_compiler(words: str) -> None:
    code = (
        'import atexit, sys; from piezo_hysteresis.cli.main import main\n'
        'heavy = ["numpy", "scipy", "numba", "rclpy"]\n'
        'atexit.register(lambda: print(*filter(sys.modules.get, heavy), file=sys.stderr))\n'
        f'main({words.split()!r})'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert (done.stdout[:6], done.stderr.strip()) == ('usage:', '')
