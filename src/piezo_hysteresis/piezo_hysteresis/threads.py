"""How many threads the linear algebra takes, for programs of our own.

What is parallel here runs over records and candidates in threads of its own. Those of the linear
algebra wait for each other by spinning, which beside busy neighbours takes a hundred times as long
as the work itself.
"""

import os


def one_for_linear_algebra() -> None:
    """Let BLAS work in the thread that calls it; to be called before numpy is imported.

    What the user has set stays.
    """
    for name in ('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS'):
        os.environ.setdefault(name, '1')
