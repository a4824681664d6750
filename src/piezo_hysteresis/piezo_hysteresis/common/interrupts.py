"""Runs a command line as a process: a Ctrl-C shows no traceback, from the first line on."""

from __future__ import annotations

import importlib
import os
import signal
import sys


def run_command_line(module: str, **known: object) -> int:
    """Import `module`, run its ``main`` with the arguments `known`, and return the exit code.

    During the import an interrupt ends the process silently, without a traceback. After that a
    message is printed and the exit code is 130. During the shutdown of the interpreter an
    interrupt is ignored, because the outcome is already printed.
    """
    _on_interrupt(signal.SIG_DFL)
    main = importlib.import_module(module).main
    try:
        _on_interrupt(signal.default_int_handler)
        return int(main(**known))
    except BrokenPipeError:  # the reader (head, less) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 130
    finally:
        _on_interrupt(signal.SIG_IGN)


def _on_interrupt(handler: signal._HANDLER) -> None:
    # one that the parent process has switched off (nohup, a job in the background) stays so
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handler)
