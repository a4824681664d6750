"""Every verb works as its help states with the fewest arguments."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from piezo_hysteresis.cli.main import VERBS

pytestmark = pytest.mark.slow

SINE = 'sine:frequency=5,amplitude=2e-5,duration=2'
PLANT = '--plant preset:generic_bouc_wen'
COMPENSATE = f'compensate --model model/model.yaml {PLANT} --reference {SINE}'
# Words of a verb, and what it then leaves or says; in this order, in one folder.
TABLE = [
    ('import one.csv --out bag', 'bag/metadata.yaml'),
    ('info sweep', 'output: sine_5Hz'),
    ('identify sweep --model classical --out model', 'model/report.html'),
    ('validate sweep --model model/model.yaml --out checked', 'checked/report.html'),
    (f'{COMPENSATE} --out study', 'study/report.html'),
    ('linear small --out linear.yaml', 'linear.yaml'),
    ('discover sweep --baseline classical --out found', 'found/verdict.json'),
    ('export sweep --out csv', 'csv/records.yaml'),
    ('export model/model.yaml --out library', 'library/libpiezo.a'),
    ('batch identify sets --model classical --out all', 'all/index.html'),
    ('batch discover sets --baseline classical --out missing', 'missing/index.html'),
    ('demo --data one.csv', 'out/demo/report.html'),
    ('completion bash', 'output: complete '),
]  # fmt: skip
# Verbs for controllers: test_drivers_gcs.py and docs/controllers.md run them.
ON_CONTROLLERS = {'sweep'}
# Verbs for nodes: test/ros/test_ends.py, test_verbs_for_nodes.py and the pages run them.
LIVE = {'record', 'play', 'loop', 'node', 'param', 'call', 'dashboard', 'investigate'}


def ran(
    words: str, folder: Path, program: str = 'piezo_hysteresis'
) -> subprocess.CompletedProcess[str]:
    """Run a command as a person would, and end all of it where it hangs."""
    process = subprocess.Popen(
        [sys.executable, '-m', program, *words.split()], cwd=folder, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        out, err = process.communicate(timeout=300)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        pytest.fail(f'{words}: it hangs')
    return subprocess.CompletedProcess(words, process.returncode, out, err)


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a sweep, a CSV file and a folder of both."""
    folder = tmp_path_factory.mktemp('verbs')
    plain = '--preset generic_bouc_wen --seconds 2 --frequencies'
    for words in (
        *(f'{plain} {w}' for w in ('2,5,11 --out sweep', '5 --out one.csv')),
        *(f'{plain} {w}' for w in ('3,7 --out sets/a', '4,9 --out sets/b')),
        '--waveform chirp --options highest=100 --seconds 4 --amplitudes 0.05 --out small',
    ):
        done = ran(f'sweep {words}', folder, 'piezo_sim')
        assert done.returncode == 0, done.stderr
    return folder


def test_every_verb_is_in_the_table() -> None:
    assert {words.split()[0] for words, _ in TABLE} | LIVE | ON_CONTROLLERS == set(VERBS)


@pytest.mark.parametrize(
    ('words', 'leaves'), TABLE, ids=[words.split(' -')[0] for words, _ in TABLE]
)
def test_a_verb_with_the_fewest_words(words: str, leaves: str, folder: Path) -> None:
    done = ran(words, folder)
    assert done.returncode == 0, done.stderr
    assert 'Traceback' not in done.stderr
    if leaves.startswith('output: '):
        assert leaves.removeprefix('output: ') in done.stdout
    else:
        assert (folder / leaves).stat().st_size > 0


@pytest.mark.parametrize(
    'words', ['presets', 'describe', 'stage --preset fang_p845_stage', 'sweep --out swept']
)
def test_the_simulator_with_the_fewest_words(words: str, folder: Path) -> None:
    done = ran(words, folder, 'piezo_sim')
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('\n') >= 1
