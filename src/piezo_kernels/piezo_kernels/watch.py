"""Knows whether this process compiles a kernel at this moment; imports nothing that is slow."""

from __future__ import annotations

import threading
from collections.abc import Callable

_LOCK = threading.Lock()
_STACK: list[str] = []
_LISTENERS: list[Callable[[], None]] = []
_count = 0


def compiling() -> str:
    """Return the name of the kernel that is being compiled, empty where none is."""
    with _LOCK:
        return _STACK[0] if _STACK else ''


def compiled() -> int:
    """Return how many kernels this process has compiled, not counting those within others."""
    return _count


def listen(begun: Callable[[], None]) -> Callable[[], None]:
    """Call `begun` where a compilation begins, in the thread that compiles; return the undoing."""
    _LISTENERS.append(begun)

    def leave() -> None:
        if begun in _LISTENERS:
            _LISTENERS.remove(begun)

    return leave


def begin(name: str) -> None:
    """Take note that the compilation of a kernel begins; for those who compile."""
    global _count
    with _LOCK:
        _STACK.append(name)
        outermost = len(_STACK) == 1
        _count += outermost
    if outermost:
        for begun in tuple(_LISTENERS):
            begun()


def end() -> None:
    """Take note that the newest compilation that was begun has ended."""
    with _LOCK:
        _STACK.pop()
