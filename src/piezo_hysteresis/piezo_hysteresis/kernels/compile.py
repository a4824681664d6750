"""The decorators of every per-sample kernel: numba where it is, plain Python where not.

There is one source for every kernel, so the two can only differ in speed. Kernels are compiled
without ``fastmath``: the same inputs give the same bits online and offline. Only sums over whole
records, which nothing online takes, may be taken in any order (`jit_sums`).
"""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

from piezo_hysteresis.kernels import watch

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

#: Every kernel of this process that is still in use.
MADE: weakref.WeakSet[Any] = weakref.WeakSet()

try:
    import numba
except ImportError:  # pragma: no cover - exercised by a test in a subprocess
    numba = None
else:
    from numba.core import event

    from piezo_hysteresis.kernels.cache import KernelCache
    from piezo_hysteresis.kernels.symbols import name_apart

    class _Teller(event.Listener):
        """Tells `watch` what numba compiles."""

        def on_start(self, found: Any) -> None:
            """Take note of the begin of a compilation."""
            watch.begin(found.data['dispatcher'].py_func.__qualname__)

        def on_end(self, found: Any) -> None:
            """Take note of its end."""
            watch.end()

    event.register('numba:compile', _Teller())
    name_apart()


def jit(function: Kernel) -> Kernel:
    """Compile `function` with numba and keep the machine code, or return it without numba."""
    return _kept(leaf(function), function)


def jit_sums(function: Kernel) -> Kernel:
    """Compile `function` as `jit` does, free to sum in any order: several numbers at a time.

    For long sums alone: of 8200 samples with 50 derivatives a triangular factor takes 1.6 in place
    of 3.9 ms. The same inputs give the same bits, but others than in plain Python.
    """
    if numba is None:
        return leaf(function)
    options = {'nogil': True, 'error_model': 'numpy', 'fastmath': {'reassoc', 'contract'}}
    compiled: Kernel = numba.njit(**options)(function)
    return _kept(compiled, function)


def _kept(compiled: Kernel, function: Kernel) -> Kernel:
    """Let a kernel be kept on disk."""
    if numba is not None and hasattr(compiled, 'enable_caching'):  # not with NUMBA_DISABLE_JIT
        compiled._cache = KernelCache(function)  # type: ignore[attr-defined]
        MADE.add(compiled)
    return compiled


def leaf(function: Kernel) -> Kernel:
    """Compile a piece that only lives inside other kernels: its machine code is not kept."""
    if numba is None:
        warnings.warn(
            'numba is not installed: kernels run as plain Python, some 100 times slower; '
            'install numba to compile them',
            RuntimeWarning,
            stacklevel=2,
        )
        return function
    compiled: Kernel = numba.njit(nogil=True, error_model='numpy')(function)
    return compiled


def generated(
    name: str,
    text: str,
    space: dict[str, Any],
    source: Callable[..., Any],
    digest: str,
    *,
    inner: bool,
) -> Callable[..., Any]:
    """Compile a function from generated `text`; its machine code is kept as that of others.

    Parameters
    ----------
    name : str
        Of the function in `text`.
    text : str
        Its source.
    space : dict of str to object
        What it may name.
    source : callable
        The function that it was generated from.
    digest : str
        Of `text` and of what it calls.
    inner : bool
        Whether only other kernels call it: its machine code is not kept.
    """
    exec(compile(text, f'<{name}>', 'exec'), space)
    function: Any = space[name]
    function.__module__, function.text = source.__module__, text
    if numba is None:
        return leaf(function)  # type: ignore[no-any-return]
    options = {'no_cpython_wrapper': True, 'no_cfunc_wrapper': True} if inner else {}
    compiled: Any = numba.njit(nogil=True, error_model='numpy', **options)(function)
    if not inner and hasattr(compiled, 'enable_caching'):
        kept = KernelCache(function)
        kept.known_by(digest, source)
        compiled._cache = kept
        MADE.add(compiled)
    return compiled  # type: ignore[no-any-return]
