"""Publishes a readiness heartbeat while kernels compile.

A node that compiles its kernels cannot answer anybody: the compilation fills the thread that
serves it. Another thread says meanwhile what it is at, so that nodes that wait for it know.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from enum import StrEnum

from piezo_hysteresis.kernels import watch

# How often it is said [s].
PERIOD = 1.0

# A compilation that is over sooner is nothing to tell [s].
SHORT = 0.3


class Readiness(StrEnum):
    """Whether a node can answer."""

    STARTING = 'starting'
    COMPILING = 'compiling'
    READY = 'ready'


WORKS = (Readiness.STARTING, Readiness.COMPILING)


class Herald:
    """Tells that a node starts, until `ready` is called, and whenever it compiles afterwards.

    Parameters
    ----------
    say : callable
        Publishes a state and a sentence; called in a thread of its own, and once by the caller.
    compiles : callable
        Called once where kernels are compiled in earnest, in a thread of its own.
    """

    def __init__(
        self, say: Callable[[Readiness, str], None], compiles: Callable[[], None] = lambda: None
    ) -> None:
        self._say = say
        self._compiles = compiles
        self._reported = self._closed = self._ready = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self._started = time.monotonic()
        self._leave = watch.listen(self._start)
        self._tell()
        self._start()

    def ready(self) -> None:
        """Take note that the node is served from now on."""
        self._ready = True
        self._wake.set()

    def close(self) -> None:
        """Say nothing any more."""
        self._closed = True
        self._leave()
        self._wake.set()

    def _start(self) -> None:
        thread = self._thread
        if not self._closed and (thread is None or not thread.is_alive()):
            self._started = time.monotonic() if self._ready else self._started
            self._wake.clear()
            self._thread = threading.Thread(target=self._run, name='herald', daemon=True)
            self._thread.start()

    def _run(self) -> None:
        self._wake.wait(SHORT)
        while not self._closed and (watch.compiling() or not self._ready):
            # what the node publishes through may be gone before this thread is
            with contextlib.suppress(Exception):
                self._tell()
            self._wake.clear()
            self._wake.wait(PERIOD)

    def _tell(self) -> None:
        kernel, seconds = watch.compiling(), time.monotonic() - self._started
        if kernel and not self._reported:
            self._reported = True
            self._compiles()
        state = Readiness.COMPILING if self._ready else Readiness.STARTING
        values = [state.value] if state is Readiness.STARTING else []
        values += ['compiles its kernels, once'] if kernel else []
        self._say(state, f'{": ".join(values)} ({seconds:.0f} s)')
