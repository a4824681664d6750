"""Locks that let one process compile a kernel while others wait for its result."""

from __future__ import annotations

import fcntl
import os
import time
import zlib
from pathlib import Path

from piezo_hysteresis.kernels.folders import folders

# Longest wait for another process that compiles [s]; if it hangs, all processes compile.
TIMEOUT = 300.0
LOOK = 0.05


class Turns:
    """Locks on single bytes of one file, one byte per kernel; a process that dies releases them.

    A kernel waits only for those that it calls, so that two processes never wait for each other.
    """

    def __init__(self) -> None:
        self._file: int | None = None
        self._owner = 0
        self._mine: set[int] = set()

    def take(self, name: str) -> None:
        """Acquire the lock for `name`; without locks there is no wait."""
        file, place, started = self._opened(), _place(name), time.monotonic()
        while file is not None and time.monotonic() - started < TIMEOUT:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
            except BlockingIOError:
                time.sleep(LOOK)
                continue
            except OSError:
                return  # a file system without locks
            self._mine.add(place)
            return

    def give_back(self, name: str) -> None:
        """Release the lock for `name`."""
        place = _place(name)
        if self._owner == os.getpid() and self._file is not None and place in self._mine:
            self._mine.discard(place)
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, place)

    def _opened(self) -> int | None:
        """Return the file of the locks; those of a parent process are not ours."""
        if self._owner != os.getpid():
            self._owner, self._mine = os.getpid(), set()
            self._file = next(filter(None, map(_open, folders())), None)
        return self._file


def _place(name: str) -> int:
    return zlib.crc32(name.encode())


def _open(folder: Path) -> int | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / 'turns', os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        return None
