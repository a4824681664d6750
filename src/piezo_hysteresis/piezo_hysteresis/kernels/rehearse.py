"""Runs everything that has kernels once, so that set-up compiles them and no command waits.

A package with kernels has a module ``rehearsal`` with ``REHEARSALS``: functions that do briefly
what its users do at length. The signatures are so those that are really called.
"""

from __future__ import annotations

import gc
import importlib
import multiprocessing
import os
import pkgutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from piezo_hysteresis.kernels import cache, watch
from piezo_hysteresis.kernels.compile import MADE

PACKAGES = ('piezo_sim', 'piezo_hysteresis')


@dataclass(frozen=True)
class Done:
    """Result of a rehearsal."""

    name: str  # package and function
    compiled: int  # number of compiled kernels
    seconds: float  # wall time [s]
    failed: str = ''  # reason of a failure; empty if it succeeded


def rehearsals(names: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Return package and name of the named rehearsals, or of all, longest first."""
    found = []
    for package in PACKAGES:
        module = importlib.import_module(f'{package}.rehearsal')
        found += [(package, each.__name__) for each in module.REHEARSALS]
    return [each for each in found if not names or each[1] in names]


def rehearse(which: tuple[str, str]) -> Done:
    """Run one rehearsal."""
    package, name = which
    started, before, failed = time.perf_counter(), watch.compiled(), ''
    try:
        getattr(importlib.import_module(f'{package}.rehearsal'), name)()
    except Exception as error:  # its kernels are compiled on first use
        failed = f'{type(error).__name__}: {error}'
    seconds = time.perf_counter() - started
    return Done(f'{package}: {name}', watch.compiled() - before, seconds, failed)


def rehearse_all(found: Sequence[tuple[str, str]], workers: int) -> Iterator[Done]:
    """Run rehearsals, several at a time in processes of their own."""
    kernels()  # every module is imported once, which also writes its bytecode
    # forked: nothing has been started that a fork would break
    with multiprocessing.get_context('fork').Pool(workers, _collect_rarely) as pool:
        yield from pool.imap_unordered(rehearse, found)


def _collect_rarely() -> None:
    """Look for garbage less often: a compiler makes many objects that refer to each other."""
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compile the kernels of the named rehearsals, or of all."""
    found = rehearsals(sys.argv[1:] if arguments is None else arguments)
    workers = max(1, min(4, len(os.sched_getaffinity(0))))
    started, compiled, total = time.perf_counter(), 0, len(found)
    live = sys.stderr.isatty()
    for k, done in enumerate(rehearse_all(found, workers), 1):
        compiled += done.compiled
        if done.failed:
            print(f'note: {done.name} could not be rehearsed: {done.failed}', file=sys.stderr)
        if live:
            print(f'\r  kernels: {k} of {total}, {done.name}\x1b[K', end='', file=sys.stderr)
    if live:
        print('\r\x1b[K', end='', file=sys.stderr)
    seconds = time.perf_counter() - started
    print(f'{compiled} kernels compiled in {seconds:.0f} s' if compiled else 'all compiled before')
    return 0


# Packages that need ROS, and one whose kernels are compiled for other machines only.
_ELSEWHERE = ('.nodes', '.ros', '.export.')


def kernels(packages: Iterable[str] = PACKAGES) -> dict[str, Any]:
    """Return every kernel of the packages by its name; all their modules are imported."""
    found = {}
    for package in packages:
        root = importlib.import_module(package)
        for info in pkgutil.walk_packages(root.__path__, f'{package}.'):
            if info.name.endswith('__main__') or any(each in info.name for each in _ELSEWHERE):
                continue
            module = importlib.import_module(info.name)
            for value in vars(module).values():
                function = getattr(value, 'py_func', None)
                if function is not None and function.__module__ == info.name:
                    found[f'{info.name}.{function.__qualname__}'] = value
    return found


def not_rehearsed(packages: Iterable[str] = PACKAGES) -> list[str]:
    """Return the kernels that were neither run in this process nor called by one that was."""
    everything = kernels(packages)
    reached: set[Callable[..., Any]] = set()
    # kernels generated at run time belong to no module
    for kernel in (*everything.values(), *MADE):
        if kernel.signatures:
            reached |= cache.within(kernel.py_func)
    return sorted(name for name, kernel in everything.items() if kernel.py_func not in reached)
