"""Pool of worker processes that end with their owner and can be replaced after a failure."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing.connection import wait
from types import TracebackType
from typing import TextIO

from piezo_hysteresis.errors import DataNote, PiezoError
from piezo_hysteresis.process_setup import one_for_linear_algebra


class OwnPool:
    """A process pool that can be renewed; an exception in its context ends its processes.

    Parameters
    ----------
    workers : int
        Number of processes, 1 or more.
    task : object
        Object that each process loads before it works.

    Raises
    ------
    PiezoError
        If no process can start and load the task.
    """

    def __init__(self, workers: int, task: object) -> None:
        self._workers = workers
        self._task = task
        self._others = {child.pid for child in multiprocessing.active_children()}
        one_for_linear_algebra()  # read when a process starts, so this one keeps what it has
        self.executor = self._new()

    def _new(self) -> Executor:
        # new processes: forking one with threads of numba or BLAS can block
        context = multiprocessing.get_context('spawn')
        pool = ProcessPoolExecutor(self._workers, mp_context=context, initializer=_begin)
        try:
            pool.submit(_load, self._task).result()
        except Exception as error:  # of the operating system, of pickle, of an import
            pool.shutdown(wait=True, cancel_futures=True)
            raise PiezoError(
                f'no worker process can start ({error}); use --workers 1, or free memory'
            ) from error
        return pool

    def renew(self) -> None:
        """Replace the pool after a failure."""
        self.executor.shutdown(wait=True, cancel_futures=True)
        self.executor = self._new()

    def __enter__(self) -> OwnPool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            for child in multiprocessing.active_children():
                if child.pid not in self._others:
                    child.terminate()
        self.executor.shutdown(wait=True, cancel_futures=True)


def _load(task: object) -> None:
    """Do nothing; the call requires that the process has started and loaded the task."""


def _begin() -> None:
    """Prepare a worker: only the owner handles Ctrl-C, and the worker ends with its owner.

    Warnings are one line each, without the source that caused them.
    """
    warnings.showwarning = _print_warning
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    owner = multiprocessing.parent_process()
    if owner is not None:
        threading.Thread(target=_end_with, args=(owner.sentinel,), daemon=True).start()


def _print_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    kind = 'note' if issubclass(category, DataNote) else 'warning'
    print(f'{kind}: {message}', file=sys.stderr)


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
