"""Runs a verb over many data sets; failures of single ones become rows.

Each data set has a folder with the results of the verb and a note, written last: if the note has
the fingerprint of data and settings, the data set is finished and is not computed again.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait as wait_for_end
from pathlib import Path
from typing import Any, ClassVar

from piezo_hysteresis import __version__
from piezo_hysteresis.common.results import Tabular
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError, RecordError
from piezo_hysteresis.process_setup import number_of_workers, one_for_linear_algebra
from piezo_hysteresis.records.load import content_of, files_of
from piezo_hysteresis.reporting.folder import claim, clear, write_folder

NOTE = 'job.json'
STATES = ('done', 'refused', 'failed')

Row = dict[str, Any]
Work = Callable[..., Row]  # (data, folder, **options) -> columns of the table
Progress = Callable[[float, str], None]


@dataclass(frozen=True, repr=False)
class Batch(Tabular):
    """Result of a batch.

    Attributes
    ----------
    rows : list of dict
        One per data set, in their order: ``name``, ``state`` (``done``, ``refused`` for data that
        cannot be used, ``failed`` for all else), ``error``, ``data``, ``seconds``, ``report``
        (relative path) and the columns of the verb.
    resumed : int
        Number of data sets that were already finished.
    """

    _INSTEAD: ClassVar = {
        'rows': 'results',
        'to_frame(), or rows': 'table',
        'rows, state and error of each': 'errors',
    }

    rows: list[Row]
    resumed: int

    def __repr__(self) -> str:
        counts = ', '.join(f'{count} {state}' for state, count in self.states().items() if count)
        before = f' ({self.resumed} of them before)' if self.resumed else ''
        number = len(self.rows)
        return f'{counted(number, "data set")}: {counts}{before}'

    def states(self) -> dict[str, int]:
        """Return the number of rows in each state."""
        return {state: sum(row['state'] == state for row in self.rows) for state in STATES}

    def columns(self) -> dict[str, list[Any]]:
        """Return the table by column; unknown values are None."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        return {name: [row.get(name) for row in self.rows] for name in names}


@dataclass(frozen=True)
class _Job:
    """One data set, the folder of its results, and the fingerprint of data and settings."""

    name: str
    data: str
    folder: str
    fingerprint: str

    def finished(self) -> Row | None:
        """Return the row of a valid earlier run, None if there is none."""
        row = self.noted(self.fingerprint) or {}
        # rejected data are a result; any other failure may be one of the machine
        return row if row.get('state') in ('done', 'refused') else None

    def noted(self, fingerprint: str | None) -> Row | None:
        """Return the row of a note with the fingerprint, None for work that has started."""
        try:
            note = json.loads((Path(self.folder) / NOTE).read_text(encoding='utf-8'))
            return dict(note['row']) if note['fingerprint'] == fingerprint else None
        except (OSError, ValueError, LookupError, TypeError):
            return None

    def note(self, row: Row) -> None:
        """Store the result; an empty row states that the work has started."""
        entry = {'fingerprint': self.fingerprint if row else None, 'row': row}
        write_folder(self.folder, {NOTE: json.dumps(entry, indent=2, allow_nan=False) + '\n'})

    def row(self, state: str, error: object, started: float) -> Row:
        """Return the columns that every data set has."""
        seconds = round(time.perf_counter() - started, 3)
        return {'name': self.name, 'state': state, 'error': str(error), 'data': self.data,
                'seconds': seconds, 'report': ''}  # fmt: skip


def run_batch(
    verb: str | Work,
    data: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    executor: Executor | None = None,
    processes: int = 1,
    progress: Progress = lambda fraction, words: None,
    **options: Any,
) -> Batch:
    """Run a verb over many data sets, each in a folder of its own in `out`.

    Parameters
    ----------
    verb : str or callable
        ``'identify'`` or ``'discover'``; or a function ``(data, folder, **options)`` of a module
        that writes into the folder and returns columns of the table.
    data : str, Path or sequence of them
        Data sets: bags, files, or folders. The files of a folder are one data set; a folder that
        contains only folders stands for them.
    out : str or Path
        Folder of the results: a folder per data set, ``results.csv`` and
        ``index.html``.
    executor : Executor, optional
        Executor of the work, such as that of a Dask cluster (``Client.get_executor()``). Its
        workers need `data` and `out` under the same paths.
    processes : int
        Number of processes without an executor: 1 is this process; 0 is one per core.
    progress : callable
        Called with ``(fraction, words)``.
    **options
        Arguments of `piezo_hysteresis.identify` or `piezo_hysteresis.discover`.

    Returns
    -------
    Batch
        Rows of all data sets; the row of a failed one has its error.

    Raises
    ------
    PiezoError
        If there are no data, `out` cannot be written or contains results of another verb, no
        process can start, or the given executor fails; finished results are kept.
    """
    from piezo_hysteresis.batch.table import WORK, write_tables

    work = WORK.get(verb) if isinstance(verb, str) else verb
    if work is None:
        raise PiezoError(f'a batch runs {" or ".join(WORK)}, not {verb}')
    name = verb if isinstance(verb, str) else work.__name__
    jobs = _jobs([data] if isinstance(data, str | Path) else data, out, name, options)
    claim(out, f'batch {name}')
    rows = {job.name: row for job in jobs if (row := job.finished()) is not None}
    resumed = len(rows)

    def collect(job: _Job, row: Row) -> None:
        rows[job.name] = row
        progress(len(rows) / len(jobs), f'{len(rows)} of {len(jobs)}: {job.name} {row["state"]}')

    left = [job for job in jobs if job.name not in rows]
    progress(resumed / len(jobs), f'{resumed} of {len(jobs)} were finished before')
    count = number_of_workers(processes)
    if executor is not None:
        if _in_parallel(executor, left, (work, name, options), collect):
            raise PiezoError('the executor broke down; restart it and run the batch again')
    elif count == 1:
        for job in left:
            collect(job, _do(job, work, name, options))
    else:
        _in_processes(left, count, (work, name, options), collect)
    done = Batch([rows[job.name] for job in jobs], resumed)
    write_tables(out, name, done)
    return done


def _do(job: _Job, work: Work, verb: str, options: Mapping[str, Any]) -> Row:
    """Process one data set in this process; any failure becomes a row."""
    started = time.perf_counter()
    if (known := job.finished()) is not None:  # a cluster lost the result, but the work is done
        return known
    try:
        clear(job.folder, verb)
        job.note({})
    except PiezoError as error:  # no note in a folder of another origin
        return job.row('failed', error, started)
    try:
        columns = work(job.data, job.folder, **options)
        row = job.row('done', '', started) | {'report': f'{job.name}/report.html', **columns}
    except PiezoError as error:
        row = job.row('refused', error, started)
    except Exception as error:  # one bad data set must not stop the rest
        row = job.row('failed', f'{type(error).__name__}: {error}', started)
    job.note(row)
    return row


def _in_parallel(
    executor: Executor, jobs: Sequence[_Job], task: Any, collect: Callable[[_Job, Row], None]
) -> list[_Job]:
    """Work on all jobs; return those that an executor that broke down has left."""
    running, lost = {}, []
    for job in jobs:
        try:
            running[executor.submit(_do, job, *task)] = job
        except (BrokenExecutor, OSError):  # a further process may be one too many
            lost.append(job)
    for future in as_completed(running):
        job = running[future]
        try:
            row = future.result()
        except BrokenExecutor:
            lost.append(job)
            continue
        except Exception as error:  # of a cluster that gave the job up
            row = job.row('failed', f'{type(error).__name__}: {error}', time.perf_counter())
        collect(job, row)
    return lost


def _in_processes(jobs: Sequence[_Job], count: int, task: Any, collect: Any) -> None:
    """Work in processes; if one dies, the jobs that had started are repeated one by one."""
    while jobs:
        with _processes(count) as pool:
            lost = _in_parallel(pool, jobs, task, collect)
        alone = [job for job in lost if job.noted(None) is not None]
        if len(lost) == len(jobs) and not alone:
            raise PiezoError(
                'no worker process can start and load the work; use --workers 1, or free memory'
            )
        for job in alone:
            with _processes(1) as pool:
                if _in_parallel(pool, [job], task, collect):
                    reason = 'the process that worked on it died; is there memory enough?'
                    collect(job, job.row('failed', reason, time.perf_counter()))
        jobs = [job for job in lost if job not in alone]


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """Provide processes; they end with this one, and at an exception."""
    others = {child.pid for child in multiprocessing.active_children()}
    one_for_linear_algebra()  # read when a process starts, so this one keeps what it has
    # new processes: forking one with threads of numba or BLAS can block
    context = multiprocessing.get_context('spawn')
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin)
    try:
        yield pool
    except BaseException:
        for child in multiprocessing.active_children():
            if child.pid not in others:
                child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Prepare a worker: only its owner handles Ctrl-C, and the worker ends with its owner."""
    warnings.formatwarning = lambda message, *_, **__: f'note: {message}\n'
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    owner = multiprocessing.parent_process()
    if owner is not None:
        threading.Thread(target=_end_with, args=(owner.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait_for_end([sentinel])
    os._exit(1)


def _jobs(
    data: Sequence[str | Path], out: str | Path, verb: str, options: Mapping[str, Any]
) -> list[_Job]:
    """Return one job for every data set."""
    root = Path(out).resolve()
    paths = list(dict.fromkeys(path for given in data for path in _data_sets(given, root)))
    if not paths:
        raise RecordError('no data were given; name bags, files or folders of them')
    names = Counter(_name(path) for path in paths)
    files = [Path(each) for each in _texts(options) if Path(each).exists()]
    common = _hash([verb, repr(sorted(options.items())), __version__, *map(_state, files)])
    jobs = []
    for path in paths:
        name = _name(path) if names[_name(path)] == 1 else f'{_name(path)}-{_hash(str(path))[:8]}'
        content = [_state(each) for each in files_of(path)]
        fingerprint = _hash([common, str(path), content])
        jobs.append(_Job(name, str(path), str(root / name), fingerprint))
    return jobs


def _name(path: Path) -> str:
    return path.name if path.is_dir() else path.stem


def _data_sets(given: str | Path, out: Path) -> Iterator[Path]:
    """Return the data sets of a path: itself, the bags and files in it, or its folders.

    A folder that contains files and no bag is one data set.
    """
    path = Path(given).resolve()
    if not path.is_dir():
        yield path  # a missing path results in a row with the error
        return
    found = _below(path, out)
    if not found:
        raise RecordError(f'{path} holds no bag and no file of columns; name the folder that does')
    yield from found


def _below(folder: Path, out: Path) -> list[Path]:
    content = content_of(folder)
    if content.is_bag:
        return [folder]
    own = (
        sorted((*content.files, *content.bags)) if content.bags else [folder][: len(content.files)]
    )
    inner = [each for each in content.folders if each != out]
    return [*own, *(data for each in inner for data in _below(each, out))]


def _texts(value: Any) -> Iterator[str]:
    """Return all texts in options: those that are paths of files are part of the settings."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, Sequence):
        for each in value:
            yield from _texts(each)


def _state(path: Path) -> list[Any]:
    """Return name, size and modification time of a file."""
    about = path.stat()
    return [str(path.resolve()), about.st_size, about.st_mtime_ns]


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
