"""Runs the jobs of a batch on any executor; failures of single jobs become rows."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path

from piezo_hysteresis.batch.inputs import Job, jobs_of
from piezo_hysteresis.batch.pool import OwnPool
from piezo_hysteresis.batch.tasks import Progress, Row, Task, silent
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.process_setup import number_of_workers
from piezo_hysteresis.reporting.folder import claim

Collect = Callable[[Job, Row], None]


@dataclass(frozen=True)
class Batch:
    """Result of a batch.

    Attributes
    ----------
    rows : list of dict
        One per job, in the order of the data: ``name``, ``data``, ``state`` (``done``,
        ``refused`` for data that cannot be used, ``failed`` for all else), ``error``,
        ``seconds``, ``report`` (relative path) and the columns of the task.
    resumed : int
        Number of jobs that were already finished.
    notes : list of str
        Remarks for the user, such as a format that could not be written.
    """

    rows: list[Row]
    resumed: int
    notes: list[str]


def run_batch(
    task: Task,
    data: Sequence[str | Path],
    out: str | Path,
    *,
    executor: Executor | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Batch:
    """Run a task over many bags and CSV files.

    Every job has its own folder in `out`, with the results of the verb and a note that it is
    finished. A job with a valid note for its data and settings is not run again.

    Parameters
    ----------
    task : Task
        `Identify`, `Discover`, or a similar object.
    data : sequence of str or Path
        Bags and CSV files, or folders of them.
    out : str or Path
        Folder of the results: a folder per job, ``results.csv``, ``results.parquet`` and
        ``index.html``.
    executor : Executor, optional
        Executor of the jobs: threads, processes, a Dask cluster (``Client.get_executor()``). Its
        workers need `data` and `out` under the same paths.
    workers : int
        Number of processes without an executor: 1 is this process; 0 is one per core.
    progress : callable
        Called with ``(fraction, words)``.

    Returns
    -------
    Batch
        Rows of all jobs; the row of a failed job has its error.

    Raises
    ------
    PiezoError
        If there are no data, `out` cannot be written or contains results of another verb, no
        process can start, or the given executor fails; finished results are kept.
    """
    from piezo_hysteresis.batch.results_table import write_tables  # draws: not for the workers

    jobs = jobs_of(task, data, out)
    claim(out, f'batch {task.verb}')
    rows = {job.name: row for job in jobs if (row := job.finished()) is not None}
    resumed = len(rows)

    def collect(job: Job, row: Row) -> None:
        rows[job.name] = row
        progress(len(rows) / len(jobs), f'{len(rows)} of {len(jobs)}: {job.name} {row["state"]}')

    left = [job for job in jobs if job.name not in rows]
    progress(resumed / len(jobs), f'{resumed} of {len(jobs)} were finished before')
    if executor is not None:
        if _round(task, left, executor, len(left), collect):
            raise PiezoError('the executor broke down; restart it and run the batch again')
    elif number_of_workers(workers) == 1:
        for job in left:
            collect(job, work(task, job))
    elif left:
        _in_own_pools(task, left, number_of_workers(workers), collect)
    ordered = [rows[job.name] for job in jobs]
    return Batch(ordered, resumed, write_tables(out, task.verb, ordered))


def work(task: Task, job: Job) -> Row:
    """Do one job in this process; any failure becomes a row."""
    started = time.perf_counter()
    if (known := job.finished()) is not None:  # a cluster lost the result, but the work is done
        return known
    try:
        job.begin(task.verb)
    except PiezoError as error:  # no note in a folder of another origin
        return _row(job, 'failed', str(error), started)
    try:
        done = {'report': f'{job.name}/report.html', **task([job.data], job.folder)}
        row = _row(job, 'done', '', started) | done
    except PiezoError as error:
        row = _row(job, 'refused', str(error), started)
    except Exception as error:  # one bad bag must not stop the rest
        row = _row(job, 'failed', f'{type(error).__name__}: {error}', started)
    job.note(row)
    return row


def _row(job: Job, state: str, error: str, started: float) -> Row:
    seconds = round(time.perf_counter() - started, 3)
    return {
        'name': job.name, 'state': state, 'error': error, 'data': job.data,
        'seconds': seconds, 'report': '',
    }  # fmt: skip


def _in_own_pools(task: Task, jobs: Sequence[Job], workers: int, collect: Collect) -> None:
    """Work in processes; a broken pool is replaced, and the job that broke it is found singly."""
    with OwnPool(workers, task) as pool:
        suspects: list[Job] = []
        while jobs:
            lost = _round(task, jobs, pool.executor, workers, collect)
            suspects += lost.running
            jobs = lost.waiting
            if lost:
                pool.renew()
        for job in suspects:
            if _round(task, [job], pool.executor, 1, collect):
                pool.renew()
                reason = 'the process that worked on it died; is there memory enough?'
                collect(job, _row(job, 'failed', reason, time.perf_counter()))


@dataclass(frozen=True)
class _Lost:
    """Jobs without a row after a failure of the executor: those in work, and the rest."""

    running: list[Job]
    waiting: list[Job]

    def __bool__(self) -> bool:
        return bool(self.running or self.waiting)


def _round(
    task: Task, jobs: Sequence[Job], executor: Executor, at_once: int, collect: Collect
) -> _Lost:
    """Submit jobs, `at_once` at a time, until all are done or the executor breaks."""
    waiting, running = list(reversed(jobs)), dict[Future[Row], Job]()
    lost: list[Job] = []
    while (waiting and not lost) or running:
        while waiting and not lost and len(running) < at_once:
            job = waiting.pop()
            try:
                running[executor.submit(work, task, job)] = job
            except (BrokenExecutor, OSError):  # a further process may be one too many
                lost.append(job)
        for future in wait(running, return_when=FIRST).done:
            job = running.pop(future)
            try:
                collect(job, future.result())
            except BrokenExecutor:
                lost.append(job)
            except Exception as error:  # of a cluster that gave the job up
                message = f'{type(error).__name__}: {error}'
                collect(job, _row(job, 'failed', message, time.perf_counter()))
    return _Lost(lost, list(reversed(waiting)))


def settled(rows: Sequence[Row]) -> dict[str, int]:
    """Return the number of rows in each state."""
    states = ('done', 'refused', 'failed')
    return {state: sum(row['state'] == state for row in rows) for state in states}
