"""Set-up of a process of our own: memory, and the number of threads and processes.

Records and candidates are processed in threads of the suite. Those of the linear
algebra wait for each other by spinning, which takes a hundred times as long as the work itself on
a busy machine.
"""

from __future__ import annotations

import contextlib
import ctypes
import os

from piezo_hysteresis.errors import PiezoError

# Of mallopt(3).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
# Larger pieces still go back at once [bytes], the largest that the GNU C library keeps by itself.
_LARGE = 32 * 2**20
# Free memory that is kept at most [bytes].
_KEPT = 256 * 2**20


def kept_for_arrays() -> None:
    """Let freed arrays be used again; where the C library has no such setting, do nothing.

    Derivatives of a record by its parameters come and go by the thousand, some megabytes each. As
    the C library is set, each goes back to the system and comes again page by page: with 50
    parameters that took 40 % of the time of a fit.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        tune = ctypes.CDLL(None).mallopt
        tune(_MMAP_THRESHOLD, _LARGE)
        tune(_TRIM_THRESHOLD, _KEPT)
        tune(_ARENA_MAX, 1)  # others give back what they have when they are empty


def one_for_linear_algebra() -> None:
    """Let BLAS work in the thread that calls it; to be called before numpy is imported.

    What the user has set stays.
    """
    for name in ('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS'):
        os.environ.setdefault(name, '1')


def number_of_workers(wanted: int) -> int:
    """Return how many threads or processes to start: `wanted`, or one per core for 0."""
    if wanted < 0:
        raise PiezoError(f'--workers must be 0 (one per core) or more, got {wanted}')
    return wanted or len(os.sched_getaffinity(0))
