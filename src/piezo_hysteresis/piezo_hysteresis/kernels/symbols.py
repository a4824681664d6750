"""Unique symbol names of machine code across processes.

Numba distinguishes two kernels with the same text by a counter in their symbol names, and every
process counts from one. The cached code of two processes can then contain equal names for
different kernels; the linker of a third process uses the first for both, so that a chain of
effects silently returns the numbers of another.
"""

from __future__ import annotations

import itertools
import os
import secrets

from numba.core.bytecode import FunctionIdentity

# Large enough that two processes do not collide by counting.
_BITS = 62


def name_apart() -> None:
    """Start the counter of this process, and of every forked one, at a random number."""
    _restart()
    os.register_at_fork(after_in_child=_restart)


def _restart() -> None:
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(_BITS))
