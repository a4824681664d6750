"""Changes of numba: unique symbol names, faster resolution of operations, BLAS when needed.

Numba distinguishes two kernels with the same text by a counter in their symbol names, and every
process counts from one. The cached code of two processes can then contain equal names for
different kernels; the linker of a third process uses the first for both, so that a chain of
effects silently returns the numbers of another.

Numba also tries every implementation of ``+`` for each ``+`` in a kernel, and kernels are long:
with a cache of the resolutions, derivatives compile in four fifths of the time.
"""

from __future__ import annotations

import itertools
import os
import secrets
import sys
from typing import Any

from numba.core import types
from numba.core.bytecode import FunctionIdentity
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

# Large enough that two processes do not collide by counting.
_BITS = 62


def name_apart() -> None:
    """Start the counter of this process, and of every forked one, at a random number."""
    _restart()
    os.register_at_fork(after_in_child=_restart)


def _restart() -> None:
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(_BITS))


def defer_blas() -> None:
    """Let numba import the BLAS of SciPy with the first kernel that uses it.

    Without this, numba imports it with the first kernel of a process, to know that it is there:
    0.15 s of each start of a node. Kernels with ``np.dot`` compile and run as before.
    """
    if 'numba.np.arraymath' in sys.modules:
        return
    from numba.np import linalg as algebra

    check = algebra.ensure_blas
    algebra.ensure_blas = lambda: None
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        algebra.ensure_blas = check


_RESOLVE: Any = BaseFunction.get_call_type
_KNOWN: dict[Any, tuple[Any, Any]] = {}


def cache_resolutions() -> None:
    """Cache the resolution for plain numbers in this process."""
    setattr(BaseFunction, 'get_call_type', _resolved)  # noqa: B010 # not by assignment for mypy


def _resolved(self: Any, context: Any, arguments: Any, named: Any) -> Any:
    """Return the signature of a call, as numba does."""
    flags = ConfigStack.top_or_none()
    numbers = all(isinstance(each, types.Number | types.Boolean) for each in arguments)
    if named or not numbers or flags is None or flags.fastmath:  # which may need another
        return _RESOLVE(self, context, arguments, named)
    key = id(self), context, flags.error_model, *arguments
    if key not in _KNOWN:
        # with the type itself, because its id can be reused
        _KNOWN[key] = self, _RESOLVE(self, context, arguments, named)
    return _KNOWN[key][1]
