"""Names of machine code that no two processes give to different code.

Numba tells two kernels of one text apart by a number in the name of their symbols, and every
process counts from one. Code that two processes have kept then holds equal names for different
kernels, and the linker of a third that reads both takes the first for either: a chain of effects
silently answers with the numbers of another.
"""

from __future__ import annotations

import itertools
import os
import secrets

from numba.core.bytecode import FunctionIdentity

# So long that two processes do not meet, and numbers after it are not reached by counting.
_BITS = 62


def name_apart() -> None:
    """Let this process, and every one that is forked from it, count from a number of its own."""
    _restart()
    os.register_at_fork(after_in_child=_restart)


def _restart() -> None:
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(_BITS))
