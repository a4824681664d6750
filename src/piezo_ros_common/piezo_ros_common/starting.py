"""Entry points of nodes: what is slow is imported with the signals already in hand."""

from __future__ import annotations

import importlib
import os
import signal
from collections.abc import Callable


def quiet_start() -> None:
    """End the process at once and in silence on SIGINT or SIGTERM; until `run_node` takes over.

    A Ctrl-C while modules are imported would otherwise show where in them it came. Nothing has
    been opened yet, so that nothing is left behind.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def node_executable(module: str) -> Callable[[], None]:
    """Return an entry point that runs ``main`` of `module`."""

    def run() -> None:
        quiet_start()
        importlib.import_module(module).main()

    run.__doc__ = f'Run {module}.'
    return run


# Named here because to import anything of piezo_sim is slow already.
simulator = node_executable('piezo_sim.nodes.simulator')
