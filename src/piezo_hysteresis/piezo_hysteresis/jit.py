"""The ``jit`` decorator of every per-sample kernel: numba where it is, plain Python where not.

There is one source for every kernel, so the two can only differ in speed.
"""

import warnings
from collections.abc import Callable
from typing import TypeVar

Kernel = TypeVar('Kernel', bound=Callable[..., object])

try:
    import numba
except ImportError:  # pragma: no cover - exercised by a test in a subprocess
    numba = None


def jit(function: Kernel) -> Kernel:
    """Compile `function` with numba (cached on disk), or return it as it is without numba.

    Kernels are compiled without ``fastmath``: the same inputs give the same bits online and
    offline.
    """
    if numba is None:
        warnings.warn(
            'numba is not installed: kernels run as plain Python, some 100 times slower; '
            'install numba to compile them',
            RuntimeWarning,
            stacklevel=2,
        )
        return function
    compiled: Kernel = numba.njit(cache=True, nogil=True, error_model='numpy')(function)
    return compiled
