"""A Ctrl-C at any moment of a command shows no traceback."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

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
