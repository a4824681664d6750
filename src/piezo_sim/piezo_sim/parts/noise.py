"""Counter-based random numbers: draw k of stream i depends only on (seed, i, k).

The noise of one effect therefore stays the same when another effect is switched on, a run sample
by sample draws the same numbers as a run of a whole array, and a reset repeats them.
"""

from __future__ import annotations

import math

import numpy as np

from piezo_hysteresis.kernels.compile import leaf

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_STREAM = np.uint64(0xD1342543DE82EF95)
_SHIFTS = (np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11))
_S30, _S27, _S31, _S11 = _SHIFTS
_SCALE = 1.0 / 9007199254740992.0
_TWO = np.uint64(2)
_ONE = np.uint64(1)


@leaf
def _scramble(word: np.uint64) -> np.uint64:
    word = (word ^ (word >> _S30)) * _MIX_1
    word = (word ^ (word >> _S27)) * _MIX_2
    return word ^ (word >> _S31)


@leaf
def uniform(seed: np.uint64, stream: int, count: np.uint64) -> float:
    """Return a number in (0, 1)."""
    base = _scramble(seed + np.uint64(stream) * _STREAM)
    return (float(_scramble(base + count * _GOLDEN) >> _S11) + 0.5) * _SCALE


@leaf
def normal(seed: np.uint64, stream: int, count: np.uint64) -> float:
    """Return a normally distributed number of unit variance (Box and Muller)."""
    base = _scramble(seed + np.uint64(stream) * _STREAM)
    first = (float(_scramble(base + (_TWO * count) * _GOLDEN) >> _S11) + 0.5) * _SCALE
    second = (float(_scramble(base + (_TWO * count + _ONE) * _GOLDEN) >> _S11) + 0.5) * _SCALE
    return math.sqrt(-2.0 * math.log(first)) * math.cos(2.0 * math.pi * second)
