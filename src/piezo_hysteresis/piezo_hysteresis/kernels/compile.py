"""Decorators of all per-sample kernels: compiled by numba if it is installed, else plain Python.

Every kernel has one source, so the two differ only in speed. Kernels are compiled without
``fastmath``: equal inputs give equal bits online and offline. Only sums over whole records, which
are not used online, may be reordered (`jit_sums`).
"""

from __future__ import annotations

import sys
import warnings
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from piezo_hysteresis.kernels import watch

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

#: Every kernel of this process that is still in use.
MADE: weakref.WeakSet[Any] = weakref.WeakSet()


@contextmanager
def _without(name: str) -> Iterator[None]:
    """Let the import of an optional module fail, unless it is imported already."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]


try:
    # where coverage is installed numba imports it, which a start of a node takes 45 ms longer
    with _without('coverage'):
        import numba
except ImportError:  # pragma: no cover - exercised by a test in a subprocess
    numba = None
else:
    from numba.core import event
    from numba.core.registry import CPUDispatcher
    from numba.core.types.misc import unliteral

    from piezo_hysteresis.kernels.cache import KernelCache
    from piezo_hysteresis.kernels.numba_changes import cache_resolutions, name_apart

    class _Listener(event.Listener):
        """Notifies `watch` of compilations by numba."""

        def on_start(self, found: Any) -> None:
            """Report the start of a compilation."""
            watch.begin()

        def on_end(self, found: Any) -> None:
            """Report the end of a compilation."""
            watch.end()

    event.register('numba:compile', _Listener())
    name_apart()
    cache_resolutions()

    class _Kernel(CPUDispatcher):
        """A kernel that is compiled once for all constants that others call it with."""

        def get_call_template(self, arguments: Any, named: Any) -> Any:
            """Compile for the types of the arguments; numba would for each value of a constant."""
            return super().get_call_template(tuple(map(unliteral, arguments)), named)

    class _Piece(_Kernel):
        """A kernel without an entry for Python, which runs it as plain Python."""

        def __call__(self, *arguments: Any) -> Any:
            """Return what the source of the kernel returns."""
            return self.py_func(*arguments)


# Entries for C and for Python take 60 % of the time that a small kernel compiles.
_OPTIONS = {'nogil': True, 'error_model': 'numpy', 'no_cfunc_wrapper': True}


def jit(function: Kernel) -> Kernel:
    """Compile `function` with numba and keep the machine code, or return it without numba."""
    if _is_missing():
        return function
    compiled: Kernel = _kept(numba.njit(**_OPTIONS)(function), function)
    return compiled


def jit_sums(function: Kernel) -> Kernel:
    """Compile `function` as `jit` does, free to sum in any order: several numbers at a time.

    For long sums alone: of 8200 samples with 50 derivatives a triangular factor takes 1.6 in place
    of 3.9 ms. The same inputs give the same bits, but others than in plain Python.
    """
    if _is_missing():
        return function
    options = {**_OPTIONS, 'fastmath': {'reassoc', 'contract'}}
    compiled: Kernel = _kept(numba.njit(**options)(function), function)
    return compiled


def inline_jit(function: Kernel) -> Kernel:
    """Compile a function that only other kernels call: no Python entry point, not cached."""
    compiled: Kernel = function if _is_missing() else _piece(function)
    return compiled


def _piece(function: Any) -> Any:
    compiled: Any = numba.njit(**_OPTIONS, no_cpython_wrapper=True)(function)
    if isinstance(compiled, CPUDispatcher):  # not with NUMBA_DISABLE_JIT
        compiled.__class__ = _Piece
    return compiled


def _kept(compiled: Any, function: Any, cache: Any = None) -> Any:
    """Enable the disk cache of a kernel."""
    if isinstance(compiled, CPUDispatcher):  # not with NUMBA_DISABLE_JIT
        compiled.__class__ = _Kernel
        compiled._cache = KernelCache(function) if cache is None else cache
        MADE.add(compiled)
    return compiled


def _is_missing() -> bool:
    """Return whether numba is missing; warn at the line that defines the kernel."""
    if numba is None:
        warnings.warn(
            'numba is not installed: kernels run as plain Python, some 100 times slower; '
            'install numba to compile them',
            RuntimeWarning,
            stacklevel=3,
        )
    return numba is None


def generated(
    name: str,
    text: str,
    space: dict[str, Any],
    source: Callable[..., Any],
    digest: str,
    *,
    inner: bool,
) -> Callable[..., Any]:
    """Compile a function from generated `text`, with the same cache."""
    exec(compile(text, f'<{name}>', 'exec'), space)
    function: Any = space[name]
    function.__module__, function.text = source.__module__, text
    if _is_missing():
        return function  # type: ignore[no-any-return]
    if inner:
        return _piece(function)  # type: ignore[no-any-return]
    cache = KernelCache(function)
    cache.named_by_digest(digest, source)
    return _kept(numba.njit(**_OPTIONS)(function), function, cache)  # type: ignore[no-any-return]
