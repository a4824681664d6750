"""Entry points of the nodes, ``ros2 run piezo_hysteresis feedforward`` and so on.

Slow imports run after the signal handlers are installed.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from piezo_hysteresis.common.registry import NODES, SHEETS, package_of

HELP_FLAGS = ('-h', '--help')

# Names the process that a node must not outlive; `processes.NodeProcess` sets it.
OWNER = 'PIEZO_OWNER'

# How often a node looks for its owner, and how long it may take to end without it [s].
LOOK = 0.5
TIMEOUT = 15.0

ENDS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Block the signals that end a process; child processes inherit the mask.

    `install_early_exit_handlers` of the node unblocks them. Until then Ctrl-C would print a
    traceback of the interpreter or of the entry point.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def install_early_exit_handlers() -> None:
    """End the process immediately and silently on SIGINT or SIGTERM, until `run_node` takes over.

    A Ctrl-C during imports would otherwise print a traceback. No resource is open yet.
    """
    for number in ENDS:
        signal.signal(number, lambda *_: os._exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDS)


def end_with_owner() -> None:
    """Let the process end as on SIGTERM once the process named in `OWNER` has ended.

    This also holds if the owner is killed. Child processes do not inherit the setting.
    """
    owner = os.environ.pop(OWNER, '')
    if owner:
        watch = threading.Thread(target=_watch, args=(int(owner),), name='owner', daemon=True)
        watch.start()


def _watch(owner: int) -> None:
    while os.getppid() == owner:
        time.sleep(LOOK)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(TIMEOUT)
    os.kill(os.getpid(), signal.SIGKILL)


def refuse_start(
    reason: object, remedy: str = 'mend the arguments or the parameter file'
) -> NoReturn:
    """End a process as a verb does that cannot run: one sentence, exit code 2.

    A line of the log would add a level and a time.
    """
    print(f'error: {" ".join(str(reason).split())} ({remedy})', file=sys.stderr)
    raise SystemExit(2) from None


def print_help(node: str) -> None:
    """Print purpose and parameters of a node, from its sheet."""
    sheet = importlib.import_module(SHEETS[package_of(node)]).SHEETS[node]
    try:
        print(sheet.help_text(Path(sys.argv[0]).name), flush=True)
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def __getattr__(name: str) -> Callable[[], None]:
    """Return the entry point of a node: it runs ``main`` of its module, or prints ``--help``."""
    if name not in NODES:
        raise AttributeError(name)

    def run() -> None:
        install_early_exit_handlers()
        if any(option in HELP_FLAGS for option in sys.argv[1:]):
            return print_help(name)
        end_with_owner()
        importlib.import_module(NODES[name]).main()
        return None

    run.__doc__ = f'Run the node {name}.'
    return run
