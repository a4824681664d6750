"""What the machine code of a kernel depends on, as one number.

Numba takes a kernel for fresh while its own file is; the kernels that it calls and the constants
that it uses may come from others.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

# Modules whose names begin so belong to the suite.
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
    """Return what `function` took from the function around it: kernels made of one text differ."""
    values: list[str] = []
    _follow(function, set(), values, {}, bound=True)
    return '\n'.join(sorted(values))


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
    *,
    bound: bool = False,
) -> None:
    """Collect files and constants of a kernel and of those that it calls."""
    if id(function) in seen:
        return
    seen[id(function)] = function
    files.add(function.__code__.co_filename)
    taken = _bound(function) if bound else (*_bound(function), *_globals(function))
    for name, value in taken:
        kernel = getattr(value, 'py_func', None)
        if kernel is not None:
            if bound:
                values.append(f'{name} = {kernel.__module__}.{kernel.__qualname__}')
            _follow(kernel, files, values, seen, bound=bound)
        elif isinstance(value, np.ndarray):
            values.append(f'{name} = {value.dtype} {value.shape} {value.tobytes().hex()}')
        elif isinstance(value, (bool, int, float, complex, str, bytes, tuple, np.generic)):
            values.append(f'{name} = {value!r}')


def _bound(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    cells = function.__closure__ or ()
    for name, cell in zip(function.__code__.co_freevars, cells, strict=True):
        yield name, cell.cell_contents


def _globals(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Answer what a function names beyond itself, in modules of the suite that it names too."""
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
