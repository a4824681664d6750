"""Digest of all dependencies of the machine code of a kernel.

Numba considers a kernel valid as long as its own file is unchanged; called kernels and constants
may come from other files.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

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
