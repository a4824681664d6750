"""How long a process keeps memory that it may need again, for programs of our own.

Derivatives of a record by its parameters come and go by the thousand, some megabytes each. As the
C library is set, each goes back to the system and comes again page by page: with 50 parameters
that took 40 % of the time of a fit.
"""

import contextlib
import ctypes

# Of mallopt(3).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
# Larger pieces still go back at once [bytes], the largest that the GNU C library keeps by itself.
_LARGE = 32 * 2**20
# Free memory that is kept at most [bytes].
_KEPT = 256 * 2**20


def kept_for_arrays() -> None:
    """Let freed arrays be used again; where the C library has no such setting, do nothing."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        tune = ctypes.CDLL(None).mallopt
        tune(_MMAP_THRESHOLD, _LARGE)
        tune(_TRIM_THRESHOLD, _KEPT)
        tune(_ARENA_MAX, 1)  # others give back what they have when they are empty
