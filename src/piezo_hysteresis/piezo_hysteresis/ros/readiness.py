"""Publishes a readiness heartbeat while kernels compile.

A node that compiles its kernels does not respond, because the compilation occupies its executor
thread. A second thread publishes the state, so that waiting nodes know it.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable
from enum import StrEnum

from piezo_hysteresis.kernels import watch

# Heartbeat period [s].
PERIOD = 1.0

# Shorter compilations are not reported [s].
SHORT = 0.3


class Readiness(StrEnum):
    """Whether a node can respond."""

    STARTING = 'starting'
    COMPILING = 'compiling'
    READY = 'ready'


WORKS = (Readiness.STARTING, Readiness.COMPILING)


class HeartbeatPublisher:
    """Publishes that a node starts, until `ready` is called, and later compilations."""

    def __init__(
        self,
        publish: Callable[[Readiness, str], None],
        compiles: Callable[[], None] = lambda: None,
    ) -> None:
        self._publish_state = publish
        self._compiles = compiles
        self._reported = self._closed = self._ready = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self._started = time.monotonic()
        self._leave = watch.listen(self._start)
        self._publish()
        self._start()

    def ready(self) -> None:
        """Mark the node as ready."""
        self._ready = True
        self._wake.set()

    def close(self) -> None:
        """Stop publishing."""
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
            # the publisher may be destroyed before this thread ends
            with contextlib.suppress(Exception):
                self._publish()
            self._wake.clear()
            self._wake.wait(PERIOD)

    def _publish(self) -> None:
        kernel, seconds = watch.compiling(), time.monotonic() - self._started
        if kernel and not self._reported:
            self._reported = True
            # rclpy searches all modules for the caller of a logger: while another
            # thread compiles, this takes seconds and must not delay the heartbeats
            threading.Thread(target=self._log, name='heartbeat log', daemon=True).start()
        state = Readiness.COMPILING if self._ready else Readiness.STARTING
        values = [state.value] if state is Readiness.STARTING else []
        values += ['compiles its kernels (first start only)'] if kernel else []
        self._publish_state(state, f'{": ".join(values)} ({seconds:.0f} s)')

    def _log(self) -> None:
        with contextlib.suppress(Exception):  # the node may be destroyed
            self._compiles()


# Heartbeat timeout [s]; the heartbeat period is 1 s.
FRESH = 5.0


class Heartbeats:
    """The last heartbeat of every node of a graph."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._now = now
        self._reported_states: dict[str, tuple[str, str, float]] = {}
        self._met: dict[str, float] = {}
        self.newest = float('-inf')

    def note(self, name: str, state: str, words: str) -> None:
        """Record the heartbeat of the node `name`.

        `newest` is the time of the last heartbeat with a working state [s].
        """
        now = self._now()
        self._reported_states[name.strip('/')] = (state, words, now)
        if state in WORKS:
            self.newest = now

    def update_discovered(self, names: Iterable[str]) -> None:
        """Update the discovered nodes; nodes that have ended are removed."""
        now = self._now()
        self._met = {name: self._met.get(name, now) for name in (n.strip('/') for n in names)}

    def awaiting_first_heartbeat(self) -> list[str]:
        """Return newly discovered nodes without a first heartbeat."""
        now = self._now()
        return sorted(
            name
            for name, met in self._met.items()
            if name not in self._reported_states and now - met < FRESH
        )

    def silence(self) -> float:
        """Return the time since the last heartbeat of a working node [s], infinite without one."""
        return self._now() - self.newest

    def is_ready(self, name: str) -> bool:
        """Return whether the node `name` has reported that it is ready."""
        return self._reported_states.get(name.strip('/'), ('',))[0] == Readiness.READY

    def working(self) -> str:
        """Return the working nodes and their tasks, empty if there are none."""
        now = self._now()
        return ', '.join(
            f'{name}: {work}'
            for name, (state, work, received) in sorted(self._reported_states.items())
            if state in WORKS and now - received < FRESH
        )
