"""Makes one kernel take long to compile, in a process that finds this folder on PYTHONPATH.

``SLOW_KERNEL`` names the kernel, ``SLOW_SECONDS`` says how long. Of that kernel only what lies in
``NUMBA_CACHE_DIR`` is known beforehand; what set-up compiled is not.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import os
import sys
import time
from pathlib import Path
from typing import Any


def hold_up(dispatcher: Any) -> None:
    compiled = dispatcher._FunctionCompiler.compile

    def slowly(self: Any, args: Any, return_type: Any) -> Any:
        if self.py_func.__qualname__ == os.environ['SLOW_KERNEL']:
            end = time.monotonic() + float(os.environ['SLOW_SECONDS'])
            held = os.environ.get('SLOW_WHILE')  # a file
            # as the compiler does, this fills the thread
            while time.monotonic() < end or (held and Path(held).exists()):
                sum(range(1000))
        return compiled(self, args, return_type)

    dispatcher._FunctionCompiler.compile = slowly


def clear(cache: Any) -> None:
    everywhere, load = cache.folders, cache.KernelCache.load_overload

    def known(self: Any, *key: Any) -> Any:
        slow = self._function.__qualname__ == os.environ['SLOW_KERNEL']
        cache.folders = (lambda: everywhere()[:1]) if slow else everywhere
        try:
            return load(self, *key)
        finally:
            cache.folders = everywhere

    cache.KernelCache.load_overload = known


WAYS = {'numba.core.dispatcher': hold_up, 'piezo_hysteresis.kernels.cache': clear}


class Finder(importlib.abc.MetaPathFinder):
    """Changes a module as soon as it is imported."""

    def find_spec(self, name: Any, path: Any = None, target: Any = None) -> Any:
        change = WAYS.pop(name, None)
        spec = None if change is None else importlib.util.find_spec(name)
        if change is not None and spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: Any) -> None:
                execute(module)
                change(module)

            setattr(spec.loader, 'exec_module', exec_module)  # noqa: B010
        return spec


if 'SLOW_KERNEL' in os.environ:
    sys.meta_path.insert(0, Finder())
