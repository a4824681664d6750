"""Cache of machine code on disk, named by a digest of all that a kernel depends on.

The cache of numba reads only from writable folders, can confuse two signatures that two processes
save simultaneously, and ignores changes of kernels in other files. This cache names an entry by
all its dependencies, so that an entry is either valid or absent. Processes that need the same
kernel at the same time compile it each; entries are complete or absent.
"""

from __future__ import annotations

import functools
import hashlib
import os
import sys
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
    """Return the digest of all source and constants in the machine code of `function`."""
    parts = set[str]()
    for each in within(function):
        text = getattr(each, 'text', None)  # of one that was generated
        parts.add(_digest_of(each.__code__.co_filename) if text is None else text)
        for name, value in _named(each):
            if (text := _constant(value)) is not None:
                parts.add(f'{each.__qualname__} {name} = {text}')
    return hashlib.sha256('\n'.join(sorted(parts)).encode()).hexdigest()


def within(function: Callable[..., Any]) -> list[Any]:
    """Return the kernel and all that it calls, as Python functions."""
    found, ahead = dict[int, Any](), [function]
    while ahead:
        each = ahead.pop()
        if id(each) not in found:
            found[id(each)] = each
            ahead += [v.py_func for _, v in _named(each) if hasattr(v, 'py_func')]
    return list(found.values())


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


def _bound(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    cells = function.__closure__ or ()
    for name, cell in zip(function.__code__.co_freevars, cells, strict=True):
        yield name, cell.cell_contents


def _named(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Return what a function names beyond itself, in modules of the suite that it names too."""
    yield from _bound(function)
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
def _digest_of(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


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
        for folder in folders():
            try:
                reduced = _entry(folder, name).load(sig)
                if reduced is not None:
                    return CompileResult._rebuild(target_context, *reduced)
            except Exception:
                continue  # a file that is damaged, or not ours to read, is as good as none
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel in the first folder that can be written."""
        if data.library.has_dynamic_globals:
            return
        name = self._file(sig, data.codegen)
        for folder in folders():
            try:
                folder.mkdir(parents=True, exist_ok=True)
                _entry(folder, name).save(sig, data._reduce())
            except OSError:
                continue
            return
        _warn_once()

    def _file(self, sig: Any, codegen: Any) -> str:
        """Return the name of the file, which holds everything that the machine code depends on."""
        if self._stamps is None:
            self._stamps = closure(self._function), stamp(self._function)
        versions = _FORM, numba.__version__, llvmlite.__version__, sys.implementation.cache_tag
        parts = (*self._stamps, *versions, str(sig), str(codegen.magic_tuple()))
        digest = hashlib.sha256('\0'.join(parts).encode()).hexdigest()
        return f'{self._name}-{digest[:24]}'


def _entry(folder: Path, name: str) -> Any:
    """Return the path of a kernel in a folder; the name contains all its dependencies."""
    return IndexDataCacheFile(str(folder), name, source_stamp='')


@functools.cache
def _warn_once() -> None:
    tried = ' nor '.join(str(folder) for folder in folders())
    print(
        f'note: compiled kernels cannot be kept in {tried}: every process compiles its own; '
        'name a folder that can be written in NUMBA_CACHE_DIR',
        file=sys.stderr,
    )
