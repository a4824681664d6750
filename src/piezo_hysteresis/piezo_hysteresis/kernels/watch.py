"""Reports whether this process is compiling a kernel; has no slow imports."""

from __future__ import annotations

import threading
from collections.abc import Callable

_LOCK = threading.Lock()
_STACK: list[str] = []
_LISTENERS: list[Callable[[], None]] = []
_count = 0


def compiling() -> str:
    """Return the name of the kernel that is being compiled, empty if there is none."""
    with _LOCK:
        return _STACK[0] if _STACK else ''


def compiled() -> int:
    """Return how many kernels this process has compiled, not counting those within others."""
    return _count


def listen(callback: Callable[[], None]) -> Callable[[], None]:
    """Call `callback` where a compilation starts, in its thread; return what undoes that."""
    _LISTENERS.append(callback)

    def leave() -> None:
        if callback in _LISTENERS:
            _LISTENERS.remove(callback)

    return leave


def begin(name: str) -> None:
    """Report the start of the compilation of a kernel."""
    global _count
    with _LOCK:
        _STACK.append(name)
        outermost = len(_STACK) == 1
        _count += outermost
    if outermost:
        for callback in tuple(_LISTENERS):
            callback()


def end() -> None:
    """Report the end of the newest compilation."""
    with _LOCK:
        _STACK.pop()
