"""Final deadline of a process, also if the interpreter is blocked."""

from __future__ import annotations

import ctypes
import ctypes.util
import time
from types import TracebackType

_SIGEV_THREAD = 2
_WHOLE_SIGEVENT = 64


class _Event(ctypes.Structure):
    """``struct sigevent`` of Linux, for a function in a separate thread."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('rest', ctypes.c_byte * (_WHOLE_SIGEVENT - 32)),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``: interval and first time, each in seconds and nanoseconds."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every', 'every_ns', 'first', 'first_ns'))


class EndsWithin:
    """Ends the process with an exit code unless the ``with`` block is left before.

    A timer of the C library calls ``_exit``, because what hangs may hold the lock of Python.
    """

    def __init__(self, seconds: float, code: int) -> None:  # seconds [s]
        self._library = ctypes.CDLL(ctypes.util.find_library('c'), use_errno=True)
        self._timer = ctypes.c_void_p()
        end = ctypes.cast(self._library._exit, ctypes.c_void_p)
        self._event = _Event(value=code, notify=_SIGEV_THREAD, function=end)
        self._times = _Times(first=int(seconds), first_ns=int(seconds % 1.0 * 1e9))
        self._set = False

    def __enter__(self) -> None:
        clock = ctypes.c_int(time.CLOCK_MONOTONIC)
        made = self._library.timer_create(
            clock, ctypes.byref(self._event), ctypes.byref(self._timer)
        )
        self._set = made == 0
        if self._set:
            self._library.timer_settime(self._timer, 0, ctypes.byref(self._times), None)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._set:
            self._library.timer_delete(self._timer)
