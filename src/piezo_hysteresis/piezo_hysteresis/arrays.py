"""The array types used everywhere, and how a number that is not known is ranked."""

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def largest_if_unknown(value: float) -> float:
    """Return `value`, or infinity where it is not finite: an error not known is the worst."""
    return value if math.isfinite(value) else math.inf
