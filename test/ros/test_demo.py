"""The demo over live nodes, shortened; and what is left when a node dies or Ctrl-C comes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.cli.demo_live import run_demo
from piezo_hysteresis.records import read_bag
from piezo_hysteresis.reporting.demo_report import Plan, write_demo_report

pytestmark = pytest.mark.ros

SHORT = Plan(
    frequencies=(5, 14, 23),
    amplitudes=(1.0,),  # what is tracked: three records of each say too little of two
    seconds=1.0,
    warm_up=0.5,
    tracking_seconds=1.6,
    learning_seconds=0.4,
    judged_seconds=0.4,
)


@pytest.mark.slow
def test_the_demo_lowers_the_error_and_reports_what_it_measured(tmp_path: Path) -> None:
    fractions: list[float] = []
    demo = run_demo(SHORT, tmp_path, lambda fraction, words: fractions.append(fraction))
    assert fractions == sorted(fractions)
    none, feedforward, attenuated = demo.runs
    assert feedforward.metrics.rms < 0.25 * none.metrics.rms
    assert attenuated.metrics.rms < 0.5 * none.metrics.rms
    bags = sorted(path.name for path in (tmp_path / 'bags').iterdir())
    assert bags == ['feedforward', 'feedforward_and_attenuation', 'no_compensation', 'sweep']

    # what is reported is what lies in the bag
    (record,) = read_bag(tmp_path / 'bags' / 'no_compensation')
    assert record.reference is not None
    error = (record.displacement - record.reference)[-400:]
    summary = json.loads(json.dumps(demo.summary(), allow_nan=False))
    row = summary['tracking']['runs'][0]
    assert row['rmse_m'] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert set(row['harmonics_m']) == {'1', '2', '3', '5'}
    assert {each['record'] for each in summary['records']} == {r.name for r in demo.sweep}

    page = tmp_path / 'report.html'
    write_demo_report(page, demo.sweep, demo.found, demo.runs, demo.plan, Path('out/own'))
    assert '--model out/own/model.yaml' in page.read_text()
    assert f'{1e6 * row["rmse_m"]:.3g} µm' in (tmp_path / 'report.html').read_text()


def children(parent: int) -> dict[int, str]:
    """Return the live children of a process and their command lines."""
    found = {}
    for status in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = status.read_text().rpartition(')')[2].split()
            words = (status.parent / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
        except OSError:
            continue  # it has ended meanwhile
        if int(fields[1]) == parent and fields[0] != 'Z':
            found[int(status.parent.name)] = words
    return found


def joined(pid: int) -> bool:
    """Return whether a process has come as far as to have threads of the middleware."""
    names = (path.read_text() for path in Path(f'/proc/{pid}/task').glob('*/comm'))
    return any(name.startswith('dds.') for name in names)


def until(condition: Callable[[], bool], timeout: float = 60.0) -> None:
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, 'the awaited condition did not come true'
        time.sleep(0.05)


def alive(pid: int) -> bool:
    status = Path(f'/proc/{pid}/stat')
    return status.exists() and status.read_text().rpartition(')')[2].split()[0] != 'Z'


@pytest.mark.parametrize(
    ('victim', 'number', 'code', 'words'),
    [
        ('simulator', signal.SIGKILL, 2, 'error: node simulator ended'),
        ('demo', signal.SIGINT, 130, 'interrupted'),
        pytest.param('demo', signal.SIGTERM, 130, 'interrupted', marks=pytest.mark.slow),
    ],
    ids=['node dies', 'Ctrl-C', 'terminated'],
)
def test_an_aborted_demo_leaves_no_files(
    tmp_path: Path, victim: str, number: int, code: int, words: str
) -> None:
    out = tmp_path / 'out'
    demo = subprocess.Popen(
        [sys.executable, '-m', 'piezo_hysteresis', 'demo', '--out', str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'COLUMNS': '200'},
    )
    try:
        until(lambda: len(children(demo.pid)) >= 2 and all(map(joined, children(demo.pid))))
        started = children(demo.pid)
        simulator = next(pid for pid, line in started.items() if '/simulator ' in line)
        os.kill(simulator if victim == 'simulator' else demo.pid, number)
        printed, said = demo.communicate(timeout=60)
    finally:
        demo.kill()
    assert demo.returncode == code
    assert said.strip().startswith(words)
    assert len(said.strip().splitlines()) == 1
    assert code != 2 or 'run the demo again' in said
    assert printed == ''
    until(lambda: not any(alive(pid) for pid in started), 10.0)
    assert list(tmp_path.iterdir()) == []
