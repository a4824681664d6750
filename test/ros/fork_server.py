"""A process that forks nodes: their modules are imported and their kernels loaded once for all.

It takes requests as lines of JSON from its standard input and answers each by a number on its
standard output. It has no thread of Python and no ROS context: what it forks begins as a process
does that has just imported its modules. It ends with its standard input, and its nodes with it.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import json
import os
import pkgutil
import re
import runpy
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NoReturn

import piezo_hysteresis.nodes
import piezo_sim.nodes
from piezo_hysteresis.common.registry import NODES
from piezo_hysteresis.ros.starting import ENDS, OWNER

_TRACER = re.compile(r'/liblttng-ust(-[0-9a-f]{8})?\.so')


def prepare() -> dict[str, Callable[[], object]]:
    """Import and load what nodes import and load; return their entry points."""
    for package in (piezo_sim.nodes, piezo_hysteresis.nodes):
        for module in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
            if '.dashboard' not in module.name:  # bokeh is large, and few tests start a dashboard
                importlib.import_module(module.name)
    calls = runpy.run_path(str(Path(__file__).parents[2] / 'tools' / 'compile_kernels.py'))[
        'CALLS'
    ]
    del calls['fit']  # as long as all others together, and only a discovery needs it
    for call in calls.values():
        call()
    gc.collect()
    gc.freeze()  # nor do nodes copy the pages of these objects for each collection
    scripts = entry_points(group='console_scripts')
    return {each.name: each.load() for each in scripts if each.name in NODES}


def serve(entries: dict[str, Callable[[], object]]) -> None:
    """Answer requests; in a process that is forked, run the node and end."""
    assert threading.active_count() == 1, 'a fork loses threads, but not the locks they hold'
    tracers = loaded_tracers()
    for line in iter(sys.stdin.buffer.readline, b''):
        request = json.loads(line)
        if 'reap' in request:
            _, status = os.waitpid(request['reap'], 0)
            answer(os.waitstatus_to_exitcode(status))
        elif fork(tracers) == 0:
            become(request)
            run(entries[request['executable']])


def run(entry: Callable[[], object]) -> NoReturn:
    """Run a node and end the process.

    One that succeeds ends without taking a thousand modules apart first, which takes 0.25 s;
    `test_ends` does that with started nodes. One that has failed may have left something to the
    end of the process, and ends as any other.
    """
    try:
        entry()
    except SystemExit as wanted:
        if wanted.code:
            raise
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    os._exit(0)


def fork(tracers: Sequence[Tracer]) -> int:
    """Fork with the threads of the tracers; a process without them crashes while it ends."""
    for tracer in tracers:
        tracer.before()
    pid = os.fork()
    for tracer in reversed(tracers):
        tracer.after(in_child=pid == 0)
    return pid


class Tracer:
    """LTTng, which rclpy loads and which begins two threads as soon as it is loaded."""

    def __init__(self, path: str) -> None:
        library = ctypes.CDLL(path)
        prefix = '' if hasattr(library, 'ust_before_fork') else 'lttng_'  # since version 2.13
        self._before = library[f'{prefix}ust_before_fork']
        self._after = {
            child: library[f'{prefix}ust_after_fork_{"child" if child else "parent"}']
            for child in (False, True)
        }
        self._signals = ctypes.create_string_buffer(128)  # a sigset_t, where it keeps the mask

    def before(self) -> None:
        """Let its threads rest."""
        self._before(self._signals)

    def after(self, *, in_child: bool) -> None:
        """Let them go on, or begin anew."""
        self._after[in_child](self._signals)


def loaded_tracers() -> list[Tracer]:
    """Return every copy of LTTng in this process: each wheel may bring its own."""
    places = Path('/proc/self/maps').read_text().split()
    return [Tracer(path) for path in sorted(set(places)) if _TRACER.search(path)]


def become(request: dict[str, Any]) -> None:
    """Give this process what a started one has; answer by its number."""
    server = os.getppid()
    os.setsid()
    os.chdir(request['folder'])
    os.environ.clear()
    os.environ.update(request['environment'], **{OWNER: str(server)})
    sys.argv = [request['path'], *request['arguments']]
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    log = os.open(request['log'], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
    # only now: whoever has the number may kill the group and read the log
    answer(os.getpid())
    for output in (1, 2):
        os.dup2(log, output)
    os.close(log)


def answer(number: int) -> None:
    """Write one line past the buffers, which a fork would double."""
    os.write(1, f'{number}\n'.encode())


if __name__ == '__main__':
    # As for a started node: `install_early_exit_handlers` takes the signals up.
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDS)
    sys.path.pop(0)  # a node sees no modules of tests
    serve(prepare())
