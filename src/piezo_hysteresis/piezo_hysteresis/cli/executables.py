"""Executables of the verbs: ``ros2 run piezo_hysteresis identify ...``."""

from __future__ import annotations

import sys
from collections.abc import Callable

from piezo_hysteresis.common.interrupts import run_command_line


def __getattr__(name: str) -> Callable[[], None]:
    """Return the entry point of a verb, such as ``identify_``; setup.py lists them."""
    if name.startswith('_') or not name.endswith('_'):
        raise AttributeError(name)
    verb = name.removesuffix('_')

    def run() -> None:
        sys.exit(run_command_line('piezo_hysteresis.cli.main', verb=verb))

    run.__doc__ = f'Run the verb {verb}.'
    return run
