"""Reports whether this process is compiling a kernel; has no slow imports."""

from __future__ import annotations

import threading
from collections.abc import Callable

#: Called where a compilation starts, in its thread.
LISTENERS: list[Callable[[], None]] = []
_LOCK = threading.Lock()
_depth = 0


def compiling() -> bool:
    """Return whether a kernel is being compiled."""
    return _depth > 0


def begin() -> None:
    """Report the start of the compilation of a kernel, which can be within that of another."""
    global _depth
    with _LOCK:
        _depth += 1
        outermost = _depth == 1
    if outermost:
        for callback in tuple(LISTENERS):
            callback()


def end() -> None:
    """Report the end of the newest compilation."""
    global _depth
    with _LOCK:
        _depth -= 1
