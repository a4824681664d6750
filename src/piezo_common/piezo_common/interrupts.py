"""Runs a command line as a process: a Ctrl-C shows no traceback, from the first line on."""

from __future__ import annotations

import importlib
import signal


def run_command_line(module: str, **known: object) -> int:
    """Import `module`, run its ``main`` with what is `known`, and return the exit code.

    Until it is imported an interrupt ends the process in silence, as it does any program; Python
    would show where in the imports it came. While the interpreter shuts down it does nothing: what
    was run has said how it ended.
    """
    _on_interrupt(signal.SIG_DFL)
    main = importlib.import_module(module).main
    _on_interrupt(signal.default_int_handler)
    try:
        return int(main(**known))
    finally:
        _on_interrupt(signal.SIG_IGN)


def _on_interrupt(handler: signal._HANDLER) -> None:
    # one that whoever started us has switched off (nohup, a job in the background) stays so
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handler)
