"""How the kernels are compiled: every leaf is compiled into the one kernel that is cached."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Kernel = TypeVar('Kernel', bound=Callable[..., Any])


def leaf(function: Kernel) -> Kernel:
    """Compile a piece of the chain; not cached, since it only lives inside `whole`."""
    compiled: Kernel = numba.njit(nogil=True, error_model='numpy')(function)
    return compiled


def whole(function: Kernel) -> Kernel:
    """Compile a kernel that Python calls, and cache it on disk."""
    compiled: Kernel = numba.njit(nogil=True, error_model='numpy', cache=True)(function)
    return compiled
