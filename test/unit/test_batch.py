"""A batch: rows equal those of the serial loop, bad data are rows, a kill loses nothing done."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.batch import run_batch
from piezo_hysteresis.batch.run import NOTE
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import named
from piezo_hysteresis.process_setup import number_of_workers
from piezo_hysteresis.records import Record, load, write_bag, write_csv
from piezo_hysteresis.reporting.folder import MARKER, write_folder

DT = 1e-3
OPTIONS: dict[str, Any] = {'model': 'classical', 'count': 1}


def record(seed: int) -> Record:
    random, time = np.random.default_rng(seed), np.arange(500) * DT
    voltage = np.sin(2 * np.pi * 8 * time)
    model = named('classical')
    values = {'A1': 1e-4 * (1 + seed), 'A': 3e-5, 'beta': 1.2, 'gamma': 0.2, 'offset': 0.0}
    y = model.respond(voltage, model.pack({**model.defaults(), **values}), DT)
    return Record('sine', DT, voltage, y + 2e-8 * random.standard_normal(time.size))


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two CSV files, a bag and an unusable file, in a folder."""
    folder = tmp_path / 'data'
    (folder / 'day1').mkdir(parents=True)
    write_csv(folder / 'one.csv', record(0))
    write_csv(folder / 'day1' / 'two.csv', record(1))
    write_bag(folder / 'three', [record(2)])
    (folder / 'bad.csv').write_text('time_s,voltage_V,displacement_um\n0,0,0\n1,x,1\n')
    return folder


def gain(data: str, folder: str, slow: float = 0.0, bias: float = 0.0) -> dict[str, Any]:
    """Return the gain by least squares, quickly."""
    time.sleep(slow)
    (each,) = load(data)
    value = each.voltage @ each.displacement / (each.voltage @ each.voltage)
    return {'gain': float(value) + bias}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Say whether rows agree; sums may be rounded in another order."""
    assert one.keys() == other.keys()
    for key in one.keys() - {'seconds', 'data', 'condition'}:
        assert one[key] == (
            pytest.approx(other[key], rel=1e-6) if isinstance(other[key], float) else other[key]
        )
    return True


@pytest.mark.component
def test_one_row_each_and_a_bad_file_stops_nothing(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    assert main(['batch', 'identify', str(data), '--model', 'classical', '--no-sampling-offset',
                 '--workers', '1', '--out', str(out)]) == 0  # fmt: skip
    printed = capsys.readouterr()
    assert '4 data sets: 3 done, 1 refused' in printed.out
    assert re.search('^refused: bad: ', printed.err, re.M)  # after progress, where it takes long
    rows = {row['name']: row for row in csv.DictReader((out / 'results.csv').open())}
    assert set(rows) == {'one', 'day1', 'three', 'bad'}
    assert 'bad.csv' in rows['bad']['error']
    for name in ('one', 'day1', 'three'):
        summary = json.loads((out / name / 'summary.json').read_text())
        assert float(rows[name]['A1']) == summary['parameters']['A1']['value']
        assert float(rows[name]['nrmse_percent']) == summary['records'][0]['nrmse_percent']
        assert (out / rows[name]['report']).is_file()
    page = (out / 'index.html').read_text()
    assert '<a href="three/report.html">three</a>' in page
    assert '3 of 4 data sets' in page
    assert float(rows['day1']['A1']) > 1.5 * float(rows['one']['A1'])


@pytest.mark.slow
def test_any_executor_gives_the_rows_of_the_serial_loop(data: Path, tmp_path: Path) -> None:
    given = [data / 'day1', data / 'bad.csv', data / 'three']
    serial = run_batch('identify', given, tmp_path / 'serial', **OPTIONS)
    with ThreadPoolExecutor(2) as threads:
        parallel = run_batch('identify', given, tmp_path / 'threads', executor=threads, **OPTIONS)
    assert [row['state'] for row in serial.rows] == ['done', 'refused', 'done']
    assert all(same(one, other) for one, other in zip(parallel.rows, serial.rows, strict=True))


def test_what_is_finished_is_not_run_again_until_something_changes(
    data: Path, tmp_path: Path
) -> None:
    out = tmp_path / 'out'
    assert run_batch(gain, [data], out).resumed == 0
    before = {path: path.stat().st_mtime_ns for path in out.glob('*/job.json')}
    again = run_batch(gain, [data], out)
    assert again.resumed == len(before) == 4
    assert {path: path.stat().st_mtime_ns for path in before} == before
    (data / 'one.csv').unlink()
    write_csv(data / 'one.csv', record(3))
    changed = run_batch(gain, [data], out)
    assert changed.resumed == 3
    gains = {row['name']: row.get('gain') for row in changed.rows}
    assert float(gains['one'] or 0.0) > 3e-4
    assert gains['bad'] is None
    assert run_batch(gain, [data], out, bias=1.0).resumed == 0


def test_files_of_others_are_not_deleted(data: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    run_batch(gain, [data / 'three'], out)
    (out / 'one').mkdir(parents=True)
    (out / 'one' / 'thesis.txt').write_text('years of work')
    for bias in (0.0, 1.0):  # the second time, too
        done = run_batch(gain, [data / 'one.csv'], out, bias=bias)
        assert 'files that are no results' in done.rows[0]['error']
        assert [path.name for path in (out / 'one').iterdir()] == ['thesis.txt']
    (out / 'three' / 'remarks.txt').write_text('mine')
    write_folder(out / 'three', {'report.html': 'of an earlier run'}, 'gain')
    assert run_batch(gain, [data / 'three'], out, bias=1.0).rows[0]['state'] == 'done'
    assert {path.name for path in (out / 'three').iterdir()} == {'job.json', 'remarks.txt', MARKER}


def test_equal_names_get_folders_of_their_own(data: Path, tmp_path: Path) -> None:
    write_csv(data / 'day1' / 'one.csv', record(1))
    done = run_batch(gain, [data / 'one.csv', data / 'day1' / 'one.csv'], tmp_path / 'out')
    assert len({row['report'] for row in done.rows}) == 2


def test_a_folder_of_files_is_one_data_set_and_results_are_none(tmp_path: Path) -> None:
    for stage in range(6):
        folder = tmp_path / 'stages' / f's{stage}'
        folder.mkdir(parents=True)
        for k in range(3):
            write_csv(folder / f'r{k}.csv', record(stage))
    (tmp_path / 'stages' / 's0' / 'remarks.md').write_text('new glue')
    stages = tmp_path / 'stages'
    for given in (stages, sorted(stages.iterdir())):
        done = run_batch(count, given, stages / 'results')
        rows = {row['name']: row for row in done.rows}
        assert rows.keys() == {f's{stage}' for stage in range(6)}
        assert {row['records'] for row in done.rows} == {3}
    assert done.resumed == 6


def count(data: str, folder: str) -> dict[str, Any]:
    """Return the number of records."""
    return {'records': len(load(data))}


def test_no_data_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'empty').mkdir()
    words = ['batch', 'identify', str(tmp_path / 'empty'), '--model', 'classical', '--out',
             str(tmp_path / 'out')]  # fmt: skip
    assert main(words) == 2
    assert 'holds no bag' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def deadly(data: str, folder: str) -> dict[str, Any]:
    """Kill the process that works on what is called deadly, fail on what is called faulty."""
    if 'deadly' in data:
        os.kill(os.getpid(), signal.SIGKILL)
    if 'faulty' in data:
        raise ZeroDivisionError('no such thing')
    return gain(data, folder)


@pytest.mark.slow
def test_a_process_that_dies_or_a_task_that_fails_is_a_row(tmp_path: Path) -> None:
    for name in ('a', 'b', 'deadly', 'd', 'faulty', 'f'):
        write_csv(tmp_path / f'{name}.csv', record(len(name)))
    files = sorted(tmp_path.glob('*.csv'))
    done = run_batch(deadly, files, tmp_path / 'out', processes=2)
    rows = {row['name']: row for row in done.rows}
    assert 'died' in rows.pop('deadly')['error']
    assert 'no such thing' in rows.pop('faulty')['error']
    assert len(rows) == 4
    for name, row in rows.items():
        assert row['gain'] == pytest.approx(gain(str(tmp_path / f'{name}.csv'), '')['gain'])
    # failures may have been of the machine: they alone are tried again
    again = run_batch(deadly, files[:2], tmp_path / 'out')
    assert (again.resumed, len(again.rows)) == (2, 2)
    for name in ('deadly', 'faulty'):
        note = json.loads((tmp_path / 'out' / name / NOTE).read_text())
        assert note['row'].get('state', '') in ('', 'failed')


def test_by_default_there_is_a_worker_per_core(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    class Threads(ThreadPoolExecutor):
        """Stands for processes."""

        def __init__(self, workers: Any, **_: Any) -> None:
            asked.append(workers)
            super().__init__(workers)

    module = sys.modules['piezo_hysteresis.batch.run']
    monkeypatch.setattr(module, 'ProcessPoolExecutor', Threads)
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: range(3))
    words = ['batch', 'identify', str(data / 'bad.csv'), '--model', 'classical']
    assert main([*words, '--out', str(tmp_path / 'out')]) == 2  # its only file is refused
    assert asked == [3]
    run_batch(gain, [data], tmp_path / 'other', processes=0)
    assert asked == [3, 3]
    assert [number_of_workers(n) for n in (0, 1, 7)] == [3, 1, 7]
    with pytest.raises(PiezoError, match='--workers'):
        number_of_workers(-1)


class Unloadable:
    """Work whose import fails in every process."""

    __name__ = 'unloadable'

    def __call__(self, data: str, folder: str) -> dict[str, Any]:
        return {}

    def __reduce__(self) -> Any:
        return exec, ('import no_such_module',)


@pytest.mark.component
@pytest.mark.parametrize('fault', ['import', 'start'])
def test_a_failed_start_of_workers_is_reported(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    def refuse(*_: Any) -> None:
        raise BlockingIOError(11, 'Resource temporarily unavailable')

    if fault == 'start':
        monkeypatch.setattr('multiprocessing.context.SpawnProcess._Popen', refuse)
    task = Unloadable() if fault == 'import' else gain
    with pytest.raises(
        PiezoError, match=r'no worker process can start and load the work; use --workers 1'
    ):
        run_batch(task, [data], tmp_path / 'out', processes=2)
    assert not list((tmp_path / 'out').glob('*/job.json'))


class Broken(Executor):
    """Does one job, then breaks."""

    def __init__(self) -> None:
        self.left = 1

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Any:
        if not self.left:
            raise BrokenProcessPool('gone')
        self.left -= 1
        future: Future[Any] = Future()
        future.set_result(function(*arguments, **options))
        return future


def test_a_broken_executor_is_reported_and_finished_results_are_kept(
    data: Path, tmp_path: Path
) -> None:
    with pytest.raises(PiezoError, match='executor broke'):
        run_batch(gain, [data], tmp_path / 'out', executor=Broken())
    assert run_batch(gain, [data], tmp_path / 'out').resumed == 1


@pytest.mark.slow
def test_a_killed_batch_resumes(tmp_path: Path) -> None:
    folder, out = tmp_path / 'data', tmp_path / 'out'
    folder.mkdir()
    for k in range(12):
        write_csv(folder / f'r{k:02}.csv', record(k))
    code = (
        f'import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n'
        'from test_batch import Path, gain, run_batch\n'
        f'data = sorted(Path({str(folder)!r}).iterdir())\n'
        f'run_batch(gain, data, {str(out)!r}, processes=2, slow=0.5)\n'
    )
    child = subprocess.Popen([sys.executable, '-c', code])

    def finished() -> list[Any]:
        return [p for p in out.glob('*/job.json') if '"state": "done"' in p.read_text()]

    deadline = time.monotonic() + 240
    while len(finished()) < 2:
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    workers = Path(f'/proc/{child.pid}/task/{child.pid}/children').read_text().split()
    child.kill()
    child.wait()
    assert not (out / 'results.csv').exists()
    while not all(gone(pid) for pid in workers):  # none of its processes works on
        assert time.monotonic() < deadline
        time.sleep(0.05)
    kept = {path: path.stat().st_mtime_ns for path in finished()}
    assert 2 <= len(kept) < 12
    done = run_batch(gain, sorted(folder.iterdir()), out, slow=0.5)
    assert done.resumed == len(kept)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    whole = run_batch(gain, sorted(folder.iterdir()), tmp_path / 'again')
    assert all(same(one, other) for one, other in zip(done.rows, whole.rows, strict=True))


def gone(pid: str) -> bool:
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] in 'ZX'
    except FileNotFoundError:
        return True
