"""Compiled kernels of blocks, one for a group of parallel blocks."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Kernel
from piezo_hysteresis.blocks.parallel import ParallelBlock
from piezo_hysteresis.jit import inline_jit, jit, scratch


def kernel_of(block: Block, dt: float, points: int = 0) -> Kernel:  # dt [s]
    """Return the kernel of a block, for a path of `points` values per tick if it supports one."""
    if isinstance(block, ParallelBlock):
        return _parallel_sum(block.parts, dt, points)
    if block.kernel is not None and (not points or block.path_kernel is None):
        return block.kernel
    return _follower(block.path_kernel, points or 1)


@functools.cache
def _follower(along: Any, points: int) -> Kernel:
    """Return the kernel of a block for a given number of path points per tick."""

    @inline_jit
    def follow(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        along(x, y, state, p, dt, frequency, points)

    return follow


def _parallel_sum(parts: Sequence[Block], dt: float, points: int) -> Kernel:
    """Return the kernel of the sum of several blocks with the same input."""
    whole = kernel_of(parts[0], dt, points)
    size, values = parts[0].initial_state(dt).size, len(parts[0].parameters)
    for part in parts[1:]:
        whole = _with(whole, kernel_of(part, dt, points), size, values)
        size += part.initial_state(dt).size
        values += len(part.parameters)
    return whole


def _with(first: Any, other: Any, size: int, values: int) -> Kernel:
    """Return the sum of two kernels; state and parameters of the second come second."""

    @jit
    def both(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        first(x, y, state[:size], p[:values], dt, frequency)
        answer = scratch(x.size)
        other(x, answer, state[size:], p[values:], dt, frequency)
        for k in range(y.size):
            y[k] += answer[k]

    return both
