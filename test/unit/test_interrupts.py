"""Processes: Ctrl-C, deadlines, threads, and reasons of the system in words."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from piezo_hysteresis.common.parameter_table import ParameterSpec
from piezo_hysteresis.common.wording import OneLineParser, reason_of

TALE = """
import atexit, sys, time
print('imports', flush=True)
if sys.argv[1] == 'imports':
    time.sleep(60)

def main(verb=''):
    print('runs', flush=True)
    if sys.argv[1] == 'runs':
        time.sleep(60)
    return 0

@atexit.register
def end():
    print('ends', flush=True)
    if sys.argv[1] == 'ends':
        time.sleep(0.5)
"""
# as from a terminal: whoever runs these tests in the background has switched interrupts off
RUN = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from piezo_hysteresis.common.interrupts import run_command_line
sys.exit(run_command_line('tale'))
"""


@pytest.mark.parametrize(
    ('moment', 'code', 'said'),
    [('imports', -signal.SIGINT, ''), ('runs', 130, 'interrupted\n'), ('ends', 0, '')],
)
def test_an_interrupt_shows_no_traceback(
    tmp_path: Path, moment: str, code: int, said: str
) -> None:
    (tmp_path / 'tale.py').write_text(TALE)
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])
    with subprocess.Popen(
        [sys.executable, '-c', RUN, moment], env={**os.environ, 'PYTHONPATH': path}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        while process.stdout.readline().strip() != moment:
            pass
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (code, said)


def test_the_simulator_package_imports_nothing_slow_by_itself() -> None:
    look = "import sys, piezo_sim; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, '-c', look], check=False).returncode == 0


TOLD = 'import os; import {module}; print(os.environ["OPENBLAS_NUM_THREADS"])'


@pytest.mark.slow
@pytest.mark.parametrize(
    'module', ['piezo_hysteresis.cli.main', 'piezo_hysteresis.nodes.links.feedforward_node']
)
@pytest.mark.parametrize(('said', 'meant'), [(None, '1'), ('3', '3')])
def test_linear_algebra_works_in_the_thread_that_calls_it(
    module: str, said: str | None, meant: str
) -> None:
    environment = {k: v for k, v in os.environ.items() if k != 'OPENBLAS_NUM_THREADS'}
    if said is not None:
        environment['OPENBLAS_NUM_THREADS'] = said
    words = [sys.executable, '-c', TOLD.format(module=module)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [meant]


HANGS = """
import ctypes
from piezo_hysteresis.ros.running import EndsWithin
with EndsWithin(0.3, {code}):
    ctypes.PyDLL(None).sleep(60)  # holds the lock of Python
"""
ENDS = """
import time
from piezo_hysteresis.ros.running import EndsWithin
with EndsWithin(0.3, 3):
    pass
time.sleep(0.6)
print('ended by itself')
"""


@pytest.mark.parametrize('code', [0, 2])
def test_a_process_that_hangs_ends_with_its_exit_code(code: int) -> None:
    ended = subprocess.run([sys.executable, '-c', HANGS.format(code=code)], timeout=30)
    assert ended.returncode == code


def test_nothing_happens_to_one_that_is_done_before() -> None:
    ended = subprocess.run(
        [sys.executable, '-c', ENDS], timeout=30, capture_output=True, text=True
    )
    assert ended.returncode == 0
    assert 'ended by itself' in ended.stdout


SOURCES = sorted(Path(__file__).parents[2].glob('src/*/piezo_*/**/*.py'))


def test_a_reason_has_neither_number_nor_path(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as found:
        (tmp_path / 'gone').read_text()
    assert reason_of(found.value) == 'the path does not exist'
    assert reason_of(ValueError('two\n  lines')) == 'two lines'


def caught(handler: ast.ExceptHandler) -> set[str]:
    kinds = handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]
    return {kind.id for kind in kinds if isinstance(kind, ast.Name)}


def shows_errno(handler: ast.ExceptHandler) -> bool:
    """Return whether the text of an OSError is shown as it is."""
    text = ast.unparse(handler)
    return f'str({handler.name})' in text or f'{{{handler.name}}}' in text or 'strerror' in text


@pytest.mark.component
def test_no_handler_shows_an_error_of_the_system_as_it_is() -> None:
    of_system = {'OSError', 'FileNotFoundError', 'PermissionError', 'ConnectionError'}
    found = [
        f'{path.name}:{node.lineno}'
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.ExceptHandler) and caught(node) & of_system and shows_errno(node)
    ]
    assert not found


def test_an_option_of_a_verb_is_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneLineParser(prog='x', exit_on_error=False)
    verbs = parser.add_subparsers(metavar='VERB')
    verbs.add_parser('sweep').add_argument('--waveform')
    with pytest.raises(SystemExit):
        parser.parse_args(['sweep', '--wavefrm', 'sine'])
    assert '--wavefrm is not understood (did you mean --waveform?)' in capsys.readouterr().err


def test_a_choice_of_a_parameter_is_suggested() -> None:
    spec = ParameterSpec('waveform', 'sine', 'Shape.', choices=('sine', 'chirp'))
    assert spec.judge('chrp').endswith("got 'chrp' (did you mean chirp?)")
