"""Batch on a local Dask cluster against the serial loop: throughput, a killed worker, equal rows.

    python bench/batch.py [--bags 24] [--workers 2]

Every bag holds two sines of an actuator of its own; each is identified, with figures and report.
The same bags go through the serial loop, through processes of our own, through a Dask cluster, and
through a Dask cluster that loses a worker half-way. Without Dask the last two are left out.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.batch import Batch, run_batch
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo, write_bag

DT = 1e-3
OPTIONS: dict[str, Any] = {'model': 'bouc_wen_mode', 'sampling_offset': False, 'count': 1}


def main() -> None:
    """Measure and print ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--bags', type=int, default=24)
    parser.add_argument('--workers', type=int, default=2)
    wanted = parsed(parser, bags=2)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        make_bags(place / 'data', wanted.bags)
        run([place / 'data' / 'bag000'], place / 'warm')  # compiled from here on
        serial, alone = timed(lambda: run([place / 'data'], place / 'serial'))
        print(
            f'serial loop: {wanted.bags} bags in {alone:.1f} s, {wanted.bags / alone:.2f} a second'
        )

        def show(name: str, done: Batch, seconds: float) -> None:
            worst = largest_difference(serial, done)
            print(
                f'{name}: {alone / seconds:.2f} times the serial loop, '
                f'parameters and errors equal within {worst:.1e}'
            )

        n = wanted.workers
        show(f'{n} processes', *timed(
            lambda: run([place / 'data'], place / 'own', processes=n)
        ))  # fmt: skip
        try:
            import distributed
        except ModuleNotFoundError:
            print('Dask is not installed (pip install dask distributed): nothing more to measure')
            return
        print(f'dask {distributed.__version__}')
        with cluster(n) as (executor, _):
            show(f'Dask, {n} workers', *timed(
                lambda: run([place / 'data'], place / 'dask', executor=executor)
            ))  # fmt: skip
        with cluster(n) as (executor, kill):
            murder = threading.Thread(target=kill_half_way, args=(place / 'killed', wanted, kill))
            murder.start()
            done, seconds = timed(
                lambda: run([place / 'data'], place / 'killed', executor=executor)
            )
            murder.join()
            show(f'Dask, one of {n} workers killed half-way', done, seconds)


def run(data: list[Path], out: Path, **how: Any) -> Batch:
    """Identify every bag."""
    return run_batch('identify', data, out, **how, **OPTIONS)


def make_bags(folder: Path, count: int) -> None:
    """Write bags of actuators that differ."""
    model, time_ = named('bouc_wen_mode'), np.arange(2000) * DT
    for k in range(count):
        random = np.random.default_rng(k)
        values = {
            **model.defaults(), 'A1': 2e-4 * random.uniform(0.8, 1.2), 'A': 8e-5, 'beta': 0.8,
            'gamma': 0.1, 'natural_frequency': random.uniform(60, 80), 'damping_ratio': 0.02,
            'offset': 1e-6,
        }  # fmt: skip
        records = []
        for frequency in (5.0, 23.0):
            voltage = np.sin(2 * np.pi * frequency * time_)
            y = model.respond(voltage, model.pack(values), DT)
            y = y + 2e-8 * random.standard_normal(time_.size)
            info = RecordInfo('', 'sine', frequency, 1.0, 0.2)
            records.append(Record(f'sine_{frequency:g}Hz', DT, voltage, y, info=info))
        write_bag(folder / f'bag{k:03}', records)


def timed(work: Callable[[], Batch]) -> tuple[Batch, float]:
    """Return what `work` returns, and how long it took [s]."""
    started = time.perf_counter()
    done = work()
    return done, time.perf_counter() - started


@contextmanager
def cluster(workers: int) -> Iterator[tuple[Executor, Callable[[], None]]]:
    """Offer a local Dask cluster over TCP, warmed up, and the means to kill one of its workers."""
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as local,
        Client(local.scheduler_address) as client,
    ):
        client.run(warm)
        yield client.get_executor(), lambda: os.kill(local.workers[0].pid, signal.SIGKILL)


def warm() -> None:
    """Import in a worker what the first job would."""
    import piezo_hysteresis.reporting.identification_report  # noqa: F401


def kill_half_way(out: Path, wanted: Any, kill: Callable[[], None]) -> None:
    """Kill a worker when half of the jobs are done."""
    while sum('"done"' in p.read_text() for p in out.glob('*/job.json')) < wanted.bags // 2:
        time.sleep(0.05)
    kill()
    print('one worker killed')


def largest_difference(one: Batch, other: Batch) -> float:
    """Return the largest relative difference of any number of two tables.

    Raises
    ------
    SystemExit
        If a row is missing or not done, or a word differs.
    """
    worst = 0.0
    for a, b in zip(one.rows, other.rows, strict=True):
        if a['state'] != 'done' or a.keys() != b.keys():
            raise SystemExit(f'rows differ: {a} {b}')
        for key in a.keys() - {'seconds', 'condition'}:
            if isinstance(a[key], float):
                worst = max(worst, abs(a[key] - b[key]) / max(abs(a[key]), math.ulp(1.0)))
            elif a[key] != b[key]:
                raise SystemExit(f'rows differ in {key}: {a[key]} {b[key]}')
    return worst


if __name__ == '__main__':
    main()
