"""Nodes in threads of the test's own process, beside nodes that are processes of their own."""

from __future__ import annotations

import importlib
import os
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.task import Future

from piezo_ros_common.middleware import joined
from piezo_ros_common.processes import (
    TIMEOUT,
    NodeProcesses,
    ProcessError,
    ros_arguments,
)
from piezo_ros_common.running import destroy, exit_code, finish, make_executor, spin

NODES = 'piezo_hysteresis.nodes.'
# What the executable of each node makes, see the `main` of its module.
MAKERS = {
    'simulator': ('piezo_sim.nodes.simulator', 'Simulator'),
    'excitation': (f'{NODES}excitation.excitation', 'Excitation'),
    'feedforward': (f'{NODES}links.feedforward', 'Feedforward'),
    'attenuation': (f'{NODES}links.attenuation', 'attenuation'),
    'feedback': (f'{NODES}links.feedback', 'feedback'),
    'control_loop': (f'{NODES}links.control_loop', 'ControlLoop'),
    'identification': (f'{NODES}identification', 'IdentificationNode'),
    'gap_monitor': (f'{NODES}gap_monitor', 'GapMonitorNode'),
    'discovery': (f'{NODES}discovery', 'DiscoveryNode'),
    'recorder': (f'{NODES}recording.recorder', 'create'),
    'player': (f'{NODES}recording.player', 'PlayerNode'),
    'dashboard': (f'{NODES}dashboard.dashboard', 'Dashboard'),
}


class _EndRequest:
    """Asks a node in a thread to end, as a signal asks a process."""

    requested = False


class NodeThread:
    """A node that a thread serves; to tests it is what a process is, but for signals.

    Attributes
    ----------
    name : str
        Name of the executable.
    """

    pid = os.getpid()

    def __init__(self, executable: str, arguments: Sequence[str], context: Context) -> None:
        self.name = executable
        self._request = _EndRequest()
        self._code: int | None = None
        self._words = ''
        self._nodes: Sequence[Node] = ()
        module, maker = MAKERS[executable]
        make = getattr(importlib.import_module(module), maker)
        self._thread = threading.Thread(target=self._serve, name=executable, daemon=True)
        self._guarded(lambda: self._make(make, arguments, context))
        if self._code is None:
            self._thread.start()

    def _make(
        self, make: Callable[..., Any], arguments: Sequence[str], context: Context
    ) -> int | None:
        made = make(context=context, cli_args=list(arguments))
        self._nodes = (made,) if isinstance(made, Node) else made.nodes
        # Here because it asks for the stderr of the process, which a test may have replaced later.
        self._executor = make_executor('auto', context)
        return None

    def _guarded(self, work: Callable[[], int | None]) -> None:
        """Do something; the code is what a process would end with where it does not go on."""
        try:
            self._code = work()
        except SystemExit as wanted:
            self._code = int(wanted.code or 0)
        except BaseException:  # whoever waits for the node is told
            self._words = traceback.format_exc()
            self._code = 1

    def _serve(self) -> None:
        self._guarded(self._spin)

    def _spin(self) -> int:
        try:
            spin(self._nodes, self._executor, self._stop(), self._request)
            finish(self._nodes)
        finally:
            for node in self._nodes:
                destroy(node)
        return exit_code(self._nodes)

    def _stop(self) -> Future | None:
        return getattr(self._nodes[0], 'stop', None)

    @property
    def returncode(self) -> int | None:
        """What its process would have ended with, None while it runs."""
        return None if self._thread.is_alive() else self._code

    def signal(self, number: int) -> None:
        """Let the node end as on SIGINT; there is no other signal for a thread."""
        self._request.requested = True

    def stop(self, timeout: float = TIMEOUT) -> int:
        """End the node; return what its process would have ended with."""
        self._request.requested = True
        return self.wait(timeout)

    def wait(self, timeout: float) -> int:
        """Wait for the node to end by itself.

        Raises
        ------
        ProcessError
            If it does not within `timeout` seconds.
        """
        if self._thread.ident is not None:
            self._thread.join(timeout)
        code = self.returncode
        if code is None:
            raise ProcessError(f'{self.name} did not end within {timeout:g} s')
        return code

    def tail(self, lines: int = 3) -> str:
        """Return the end of what stopped it, on one line; the log of a thread goes to stderr."""
        return ' | '.join(self._words.strip().splitlines()[-lines:]) or '(nothing)'


class LiveNodes(NodeProcesses):
    """Nodes of one domain: some in threads of this process, some processes of their own."""

    def __init__(self, domain: int | None = None) -> None:
        super().__init__(domain)
        self._context: Context | None = None

    def serve(
        self,
        executable: str,
        parameters: Mapping[str, object] | None = None,
        *,
        name: str = '',
        namespace: str = '',
        remap: Mapping[str, str] | None = None,
        files: Sequence[Path] = (),
    ) -> NodeThread:
        """Make a node as its executable does, and let a thread of this process serve it."""
        if self._context is None:
            self._context = joined(self.domain)
        arguments = ros_arguments(parameters, name, namespace, remap, files)
        node = NodeThread(executable, arguments, self._context)
        self._running.append(node)
        return node

    def stop(self) -> list[int]:
        """End every node; return the exit codes, in the order in which they were started."""
        codes = super().stop()
        if self._context is not None:
            rclpy.shutdown(context=self._context)
            self._context = None
        return codes
