"""Cache of machine code on disk, named by a digest of all that a kernel depends on.

The cache of numba reads only from writable folders, can confuse two signatures that two processes
save simultaneously, and ignores changes of kernels in other files. This cache names an entry by
all its dependencies, so that an entry is either valid or absent; if several processes need the
same kernel, one compiles it while the others wait.
"""

from __future__ import annotations

import fcntl
import functools
import hashlib
import os
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import IndexDataCacheFile, _Cache
from numba.core.compiler import CompileResult

from piezo_hysteresis.kernels.numba_changes import defer_blas

# Prefixes of the modules of the suite.
OURS = 'piezo_'


def stamp(function: Callable[..., Any]) -> str:
    """Return the digest of all source that goes into the machine code of `function`."""
    files, values = set[str](), list[str]()
    _follow(function, files, values, {})
    digest = hashlib.sha256('\n'.join(sorted(values)).encode())
    for file in sorted(files):
        digest.update(_digest_of(file))
    return digest.hexdigest()


def closure(function: Callable[..., Any]) -> str:
    """Return the closure variables of `function`: they distinguish kernels with the same text.

    A captured kernel is represented with its own closure, in order: two chains of the same blocks
    in a different order are different kernels.
    """
    return _nested(function, {})


def _nested(function: Callable[..., Any], known: dict[int, str]) -> str:
    if id(function) not in known:
        known[id(function)] = '...'  # one that calls itself
        known[id(function)] = ', '.join(
            f'{name} = {_taken(value, known)}' for name, value in _bound(function)
        )
    return known[id(function)]


def _taken(value: Any, known: dict[int, str]) -> str:
    kernel = getattr(value, 'py_func', None)
    if kernel is not None:
        return f'{kernel.__module__}.{kernel.__qualname__}({_nested(kernel, known)})'
    text = _constant(value)
    return type(value).__name__ if text is None else text


def _constant(value: Any) -> str | None:
    """Return a captured constant as text; None for other objects."""
    if isinstance(value, np.ndarray):
        return f'{value.dtype} {value.shape} {value.tobytes().hex()}'
    constants = (bool, int, float, complex, str, bytes, tuple, np.generic)
    return repr(value) if isinstance(value, constants) else None


def within(function: Callable[..., Any]) -> set[Callable[..., Any]]:
    """Return the kernel and all that it calls, as Python functions."""
    found: dict[int, Callable[..., Any]] = {}
    _follow(function, set(), [], found)
    return set(found.values())


def _follow(
    function: Callable[..., Any],
    files: set[str],
    values: list[str],
    seen: dict[int, Callable[..., Any]],
) -> None:
    """Collect files and constants of a kernel and of those that it calls."""
    if id(function) in seen:
        return
    seen[id(function)] = function
    text = getattr(function, 'text', None)  # of one that was generated
    if text is None:
        files.add(function.__code__.co_filename)
    else:
        values.append(text)
    for name, value in (*_bound(function), *_globals(function)):
        kernel = getattr(value, 'py_func', None)
        if kernel is not None:
            _follow(kernel, files, values, seen)
        elif (text := _constant(value)) is not None:
            values.append(f'{name} = {text}')


def _bound(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    cells = function.__closure__ or ()
    for name, cell in zip(function.__code__.co_freevars, cells, strict=True):
        yield name, cell.cell_contents


def _globals(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Return what a function names beyond itself, in modules of the suite that it names too."""
    names = set(_names(function.__code__))
    known = function.__globals__
    for name in sorted(names & known.keys()):
        value = known[name]
        if not isinstance(value, ModuleType):
            yield name, value
        elif value.__name__.startswith(OURS):
            inner = names & vars(value).keys()
            yield from ((f'{name}.{each}', vars(value)[each]) for each in sorted(inner))


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


@functools.cache
def _digest_of(file: str) -> bytes:
    return hashlib.sha256(Path(file).read_bytes()).digest()


# Where set-up leaves them, below the root of the workspace.
WITHIN = Path('install', 'kernels')


@functools.cache
def folders() -> tuple[Path, ...]:
    """Return the folders in search order; new entries go to the first writable one.

    The order is ``NUMBA_CACHE_DIR`` if set, the workspace, which is also read if it is not
    writable, and the cache folder of the user.
    """
    named = os.environ.get('NUMBA_CACHE_DIR')
    own = [Path(named) / 'piezo_kernels'] if named else []
    return (*own, _workspace(), *_user())


def _workspace() -> Path:
    """Return the folder in the workspace of this file, for any kind of installation."""
    here = Path(__file__).resolve()
    for parent in here.parents:
        if (parent / 'setup.bash').is_file() and parent.name != 'install':
            return parent / WITHIN
    return here.parent / 'kernels'


def _user() -> list[Path]:
    named = os.environ.get('XDG_CACHE_HOME')
    try:
        return [(Path(named) if named else Path.home() / '.cache') / 'piezo_kernels']
    except RuntimeError:
        return []  # a process without a home folder


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


_BASE: Any = _Cache

# Changes with what an entry holds; before the second, symbols of two processes could meet.
_FORM = '2'


class KernelCache(_BASE):
    """Takes the place of numba's cache in the dispatcher of one kernel."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._name = f'{function.__module__}.{function.__qualname__}'.replace('<locals>.', '')
        self._stamps: tuple[str, str] | None = None

    def named_by_digest(self, digest: str, source: Callable[..., Any]) -> None:
        """Name entries by the digest of a generated text, and what its `source` depends on."""
        self._stamps = digest, stamp(source)

    @property
    def cache_path(self) -> str:
        """Folder that is looked into first."""
        return str(folders()[0])

    def enable(self) -> None:
        """Do nothing: the cache is always enabled."""

    def disable(self) -> None:
        """Do nothing: the cache is always enabled."""

    def flush(self) -> None:
        """Do nothing: stale entries are never found."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for a signature, None if it must be compiled."""
        defer_blas()
        target_context.refresh()
        name = self._file(sig, target_context.codegen())
        found = self._read(name, sig, target_context)
        if found is None:
            TURNS.take(name)
            found = self._read(name, sig, target_context)  # another process may have compiled it
            if found is not None:
                TURNS.give_back(name)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel where that can be done, for the next process."""
        name = self._file(sig, data.codegen)
        try:
            if not data.library.has_dynamic_globals:
                _write(name, sig, data._reduce())
        finally:
            TURNS.give_back(name)

    def _file(self, sig: Any, codegen: Any) -> str:
        """Return the name of the file, which holds everything that the machine code depends on."""
        if self._stamps is None:
            self._stamps = closure(self._function), stamp(self._function)
        versions = _FORM, numba.__version__, llvmlite.__version__, sys.implementation.cache_tag
        parts = (*self._stamps, *versions, str(sig), str(codegen.magic_tuple()))
        digest = hashlib.sha256('\0'.join(parts).encode()).hexdigest()
        return f'{self._name}-{digest[:24]}'

    def _read(self, name: str, sig: Any, target_context: Any) -> Any:
        for folder in folders():
            try:
                reduced = _entry(folder, name).load(sig)
                if reduced is not None:
                    return CompileResult._rebuild(target_context, *reduced)
            except Exception:
                continue  # a file that is damaged, or not ours to read, is as good as none
        return None


TURNS = Turns()
_warned = False


def _entry(folder: Path, name: str) -> Any:
    """Return the path of a kernel in a folder; the name contains all its dependencies."""
    return IndexDataCacheFile(str(folder), name, source_stamp='')


def _write(name: str, sig: Any, reduced: Any) -> None:
    """Keep a kernel in the first folder that can be written."""
    for folder in folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _entry(folder, name).save(sig, reduced)
        except OSError:
            continue
        return
    _warn_once()


def _warn_once() -> None:
    global _warned
    if not _warned:
        _warned = True
        tried = ' nor '.join(str(folder) for folder in folders())
        print(
            f'note: compiled kernels cannot be kept in {tried}: every process compiles its own; '
            'name a folder that can be written in NUMBA_CACHE_DIR',
            file=sys.stderr,
        )
