"""Cache of machine code on disk, one entry per kernel and signature.

The cache of numba reads only from writable folders, can confuse two signatures that two processes
save simultaneously, and ignores changes of kernels in other files. This cache names an entry by
all its dependencies, so that an entry is either valid or absent; if several processes need the
same kernel, one compiles it while the others wait.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import IndexDataCacheFile, _Cache
from numba.core.compiler import CompileResult

from piezo_hysteresis.kernels import fresh
from piezo_hysteresis.kernels.folders import folders
from piezo_hysteresis.kernels.numba_changes import defer_blas
from piezo_hysteresis.kernels.turns import Turns

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
        self._stamps = digest, fresh.stamp(source)

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
            self._stamps = fresh.closure(self._function), fresh.stamp(self._function)
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
