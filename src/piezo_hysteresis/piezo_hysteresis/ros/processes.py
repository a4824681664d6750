"""Starts nodes as processes of their own and makes sure that none outlives its owner."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from ament_index_python.packages import get_package_prefix

from piezo_hysteresis.ros.starting import OWNER, blocked_signals

TIMEOUT = 5.0

# Set by the handler of Ctrl-C: an exception that a signal raises may be swallowed where it lands,
# in a callback or a destructor, and code that waits for nodes must still see it.
INTERRUPTED = threading.Event()


class ProcessError(Exception):
    """A node process died or did not end in time; the message names it and the remedy."""


class NodeProcess:
    """A running node; it ends if its owner dies."""

    def __init__(
        self,
        package: str,
        executable: str,
        arguments: Sequence[str],
        env: Mapping[str, str],
        log: Path,
    ) -> None:
        path = Path(get_package_prefix(package)) / 'lib' / package / executable
        self.name = executable
        self.log = log
        with log.open('wb') as output, blocked_signals():
            # A separate process group: a signal for one node never reaches its owner.
            self._process = subprocess.Popen(
                [sys.executable, str(path), *arguments],
                env={**env, OWNER: str(os.getpid())},
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process number."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.poll()

    @property
    def processor_time(self) -> float:
        """Processor time used so far [s], 0 if the system does not report it."""
        try:
            fields = Path(f'/proc/{self.pid}/stat').read_text().rpartition(')')[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def signal(self, number: int) -> None:
        """Send a signal to the node."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def stop(self, timeout: float = TIMEOUT) -> int:
        """End the node politely, then firmly; return its exit code."""
        self.signal(signal.SIGINT)
        code = self._ended(timeout)
        if code is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            code = self._ended(None)
        assert code is not None  # a killed process ends
        return code

    def wait(self, timeout: float) -> int:
        """Wait for the node to end by itself."""
        code = self._ended(timeout)
        if code is None:
            raise ProcessError(
                f'{self.name} did not end within {timeout:g} s; its last words: {self.tail()}'
            )
        return code

    def _ended(self, timeout: float | None) -> int | None:
        """Wait for the end; return the exit code, None where the process still runs."""
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return None

    def tail(self, lines: int = 3) -> str:
        """Return the last lines it printed, on one line."""
        text = self.log.read_text(errors='replace').strip().splitlines()
        return ' | '.join(text[-lines:]) or '(nothing)'


_CLAIMS = itertools.count()


class NodeProcesses:
    """A group of node processes that share a domain and end together."""

    def __init__(self, domain: int | None = None) -> None:
        self._claim: IO[str] | None = None
        self.domain = self._claim_domain() if domain is None else domain
        self.environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(self.domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONUNBUFFERED': '1',
        }
        self._folder = tempfile.TemporaryDirectory(prefix='piezo_')
        self._running: list[NodeProcess] = []

    def _claim_domain(self) -> int:
        """Return a domain that is ours until we end: two loops in one domain would mix."""
        # each time another one: what a killed process has left behind in a domain stays there
        begin = os.getpid() + 7 * next(_CLAIMS)
        for k in range(100):
            domain = 1 + (begin + k) % 100
            with contextlib.suppress(OSError):
                file = (Path(tempfile.gettempdir()) / f'piezo_domain_{domain}.lock').open('w')
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    file.close()
                    continue
                self._claim = file
                return domain
        raise ProcessError('all ROS domains 1..100 are in use; end some experiments first')

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()
        self._folder.cleanup()
        if self._claim is not None:
            self._claim.close()

    def start(
        self,
        package: str,
        executable: str,
        parameters: Mapping[str, object] | None = None,
        *,
        name: str = '',
        namespace: str = '',
        remap: Mapping[str, str] | None = None,
        files: Sequence[Path] = (),
    ) -> NodeProcess:
        """Start one node."""
        arguments = ros_arguments(parameters, name, namespace, remap, files)
        log = Path(self._folder.name) / f'{len(self._running)}_{name or executable}.log'
        node = self.launch(package, executable, arguments, log)
        self._running.append(node)
        return node

    def launch(
        self, package: str, executable: str, arguments: Sequence[str], log: Path
    ) -> NodeProcess:
        """Return the process of a node; a subclass may come by it in another way."""
        return NodeProcess(package, executable, arguments, self.environment, log)

    @property
    def nodes(self) -> tuple[NodeProcess, ...]:
        """Every node that was started."""
        return tuple(self._running)

    def retire(self, node: NodeProcess) -> None:
        """End `node` permanently and stop monitoring it."""
        node.stop()
        self._running.remove(node)

    def check(self) -> None:
        """Raise if a node died unexpectedly."""
        if INTERRUPTED.is_set():
            raise KeyboardInterrupt
        for node in self._running:
            if node.returncode not in (None, 0):
                raise ProcessError(
                    f'node {node.name} ended with code {node.returncode}: {node.tail()}'
                )

    def wait_for(self, node: NodeProcess, timeout: float) -> int:
        """Wait until `node` ends while the other nodes are monitored."""
        end = time.monotonic() + timeout
        while node.returncode is None:
            self.check()
            if time.monotonic() > end:
                return node.wait(0.0)
            time.sleep(0.02)
        return int(node.returncode)

    def stop(self) -> list[int]:
        """End every node; return the exit codes, in the order in which they were started."""
        for node in self._running:
            node.signal(signal.SIGINT)
        codes = [node.stop() for node in self._running]
        self._running.clear()
        return codes


def ros_arguments(
    parameters: Mapping[str, object] | None = None,
    name: str = '',
    namespace: str = '',
    remap: Mapping[str, str] | None = None,
    files: Sequence[Path] = (),
) -> list[str]:
    """Return the arguments that give a node its parameters and names, as for `start`."""
    arguments = ['--ros-args']
    for file in files:
        arguments += ['--params-file', str(file)]
    for key, value in (parameters or {}).items():
        arguments += ['-p', f'{key}:={_as_yaml(value)}']
    special = {'__node': name, '__ns': f'/{namespace.strip("/")}' if namespace else ''}
    renamed = {key: value for key, value in special.items() if value}
    for old, new in {**(remap or {}), **renamed}.items():
        arguments += ['-r', f'{old}:={new}']
    return arguments


def _as_yaml(value: object) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, float):
        # repr gives 1e-05, which YAML 1.1 reads as a string: always show the point.
        text = repr(value)
        return text if '.' in text or 'e' not in text else text.replace('e', '.0e')
    if isinstance(value, list | tuple):
        return '[' + ', '.join(_as_yaml(each) for each in value) + ']'
    return str(value) or "''"
