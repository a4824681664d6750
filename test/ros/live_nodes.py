"""Nodes of one domain that are forked instead of started, which takes a tenth of the time."""

from __future__ import annotations

import atexit
import functools
import json
import os
import select
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

from piezo_hysteresis.cli.node import executable as path_of
from piezo_hysteresis.ros.processes import NodeProcess, NodeProcesses

# What Python, its libraries and the kernels read while they are loaded.
_READ_AT_LOADING = ('PYTHON', 'NUMBA_', 'LD_', 'OMP_', 'OPENBLAS_')


class ForkServer:
    """The process of `fork_server`, one for each process that runs tests."""

    def __init__(self) -> None:
        environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}
        self._loaded_with = _read_at_loading(environment)
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name('fork_server.py'))],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # a Ctrl-C is for the tests, which then end their nodes
        )
        self._lock = threading.Lock()

    def suits(self, environment: Mapping[str, str]) -> bool:
        """Return whether a node in `environment` would load what the server has loaded."""
        return _read_at_loading(environment) == self._loaded_with

    def ask(self, **request: object) -> int:
        """Return the answer to one request."""
        pipes = self._process
        assert pipes.stdin is not None
        assert pipes.stdout is not None
        with self._lock:
            pipes.stdin.write(json.dumps(request).encode() + b'\n')
            pipes.stdin.flush()
            line = pipes.stdout.readline()
        assert line, f'the fork server has ended with code {pipes.wait()}'
        return int(line)

    def close(self) -> None:
        """End the server, and nodes that are left."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def _read_at_loading(environment: Mapping[str, str]) -> dict[str, str]:
    return {k: v for k, v in environment.items() if k.startswith(_READ_AT_LOADING)}


@functools.cache
def fork_server() -> ForkServer:
    """Return the server of this process, which ends with it."""
    server = ForkServer()
    atexit.register(server.close)
    return server


class ForkedNode(NodeProcess):
    """A node whose process was forked; it ends with the server and so with its owner."""

    def __init__(
        self, executable: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path
    ) -> None:
        self.name = executable
        self.log = log
        self._code: int | None = None
        self._pid = fork_server().ask(
            executable=executable,
            path=str(path_of(executable)),
            arguments=list(arguments),
            environment=dict(environment),
            folder=str(Path.cwd()),
            log=str(log),
        )
        # Not reaped before it is asked for, so that the number stands for it until then.
        self._end = os.pidfd_open(self._pid)

    @property
    def pid(self) -> int:
        """Process number."""
        return self._pid

    @property
    def returncode(self) -> int | None:
        """Exit code, None while it runs."""
        return self._ended(0.0)

    def _ended(self, timeout: float | None) -> int | None:
        if self._code is None:
            end = select.poll()
            end.register(self._end, select.POLLIN)
            if end.poll(None if timeout is None else 1e3 * timeout):
                self._code = fork_server().ask(reap=self._pid)
                os.close(self._end)
        return self._code


class LiveNodes(NodeProcesses):
    """Nodes of one domain, for tests whose subject is not how a process starts.

    Each is a process of its own: a node that ends in a thread can leave Fast DDS 2.14 spinning
    with the lock of Python held, and the test with it.
    """

    def launch(
        self, package: str, executable: str, arguments: Sequence[str], log: Path
    ) -> NodeProcess:
        if fork_server().suits(self.environment):
            return ForkedNode(executable, arguments, self.environment, log)
        return super().launch(package, executable, arguments, log)
