"""How many threads and processes work at once, and how many the linear algebra takes.

What is parallel here runs over records and candidates in threads of its own. Those of the linear
algebra wait for each other by spinning, which beside busy neighbours takes a hundred times as long
as the work itself.
"""

import os

from piezo_hysteresis.errors import PiezoError


def one_for_linear_algebra() -> None:
    """Let BLAS work in the thread that calls it; to be called before numpy is imported.

    What the user has set stays.
    """
    for name in ('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS'):
        os.environ.setdefault(name, '1')


def number_of_workers(wanted: int) -> int:
    """Return how many threads or processes to start: `wanted`, or one per core for 0.

    Raises
    ------
    PiezoError
        If the number is negative.
    """
    if wanted < 0:
        raise PiezoError(f'--workers must be 0 (one per core) or more, got {wanted}')
    return wanted or len(os.sched_getaffinity(0))
