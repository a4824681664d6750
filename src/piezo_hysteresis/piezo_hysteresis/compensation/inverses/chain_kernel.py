"""Numerical inverse of a chain as one kernel, composed of the kernels of its blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Restoring
from piezo_hysteresis.compensation.inverses.block_inverse import (
    CLAMPED,
    FIRST_SLOPE,
    BlockInverse,
    block_inverse,
)
from piezo_hysteresis.compensation.inverses.inverse_link import Run
from piezo_hysteresis.compensation.inverses.structure_inverse import (
    STATE_SIZE,
    carry_ahead,
    lift_droop,
)
from piezo_hysteresis.jit import jit, leaf, scratch

# Indices in the parameters: structure, lead, reading at rest; restoring force and blocks follow.
_K1, _K2, _LEAD, REST, _BACK = range(5)
# Indices in the memory: counters, structure, memory of the restoring force, last displacement.
_CLAMPED, _STROKE, STRUCTURE = range(3)
_FORCE = STRUCTURE + STATE_SIZE
_MOVED = _FORCE + 1
_MEMORIES = _MOVED + 1


class Motion(NamedTuple):
    """A displacement [m] with its first two derivatives, or a signal without derivatives."""

    displacement: float
    velocity: float
    acceleration: float


#: ``through(motion, memory, p, dt)``: blocks in series, applied to a motion.
_Through = Callable[[Motion, FloatArray, FloatArray, float], Motion]


class ChainKernel(NamedTuple):
    """The kernel of an inverse and its memory at rest."""

    run: Run
    start: FloatArray


def chain_kernel(
    front: Sequence[tuple[Block, bool]],
    back: Sequence[tuple[Block, bool]],
    sizes: Sequence[int],
    restoring: tuple[Restoring | None, int],
    dt: float,  # [s]
) -> ChainKernel:
    """Return the inverse of a chain."""
    solved: _Through | None = None
    undone: _Through | None = None
    kept: _Through | None = None
    start = [np.zeros(_MEMORIES)]
    memory, numbers = _MEMORIES, _BACK + restoring[1]
    clamped: Any = _no_count
    for i, (block, joined) in enumerate((*front, *back)):
        inverse = block_inverse(block, dt, joined)
        if i < len(front):
            solved = _before(_solve(inverse, memory, numbers), solved)
            kept = _before(kept, _keep(inverse, memory, numbers))
        else:
            undone = _before(_undo(inverse, memory, numbers), undone)
        clamped = _counting(clamped, memory)
        start.append(inverse.start)
        memory += inverse.start.size
        numbers += sizes[i]
    acting = _nothing_back if restoring[0] is None else _acting_back(*restoring)
    return ChainKernel(
        _whole(undone, solved, kept, clamped=clamped, back=acting), np.concatenate(start)
    )


def _whole(*steps: _Through | None, clamped: Any, back: Any) -> Run:
    undone, solved, kept = (_passing() if each is None else each for each in steps)

    @jit
    def run(
        reference: FloatArray, voltage: FloatArray, memory: FloatArray, p: FloatArray, dt: float,
        low: float, high: float,
    ) -> None:  # fmt: skip
        ahead, structure = scratch((3, 1)), memory[STRUCTURE:_FORCE]
        for k in range(voltage.size):
            carry_ahead(reference[:, k : k + 1], ahead, structure, p[_LEAD], dt)
            at = Motion(ahead[0, 0] + p[REST], ahead[1, 0], ahead[2, 0])
            at = undone(at, memory, p, dt)
            place = voltage[k : k + 1]
            place[0] = at.displacement + p[_K1] * at.velocity + p[_K2] * at.acceleration
            if p[_LEAD] > 0.0:
                lift_droop(place, structure)
            target = place[0] + back(at.displacement, memory, p, dt)
            u = solved(Motion(target, 0.0, 0.0), memory, p, dt).displacement
            if u > high or u < low:
                u = min(max(u, low), high)
                memory[_STROKE] += 1.0
            voltage[k] = u
            kept(Motion(u, 0.0, 0.0), memory, p, dt)
        memory[_CLAMPED] = clamped(memory)

    return run


@leaf
def _nothing_back(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    return 0.0


def _acting_back(restoring: Any, count: int) -> Any:
    """Return the restoring force on the mode, to be added to the target at `x` [m]."""
    last = _BACK + count

    @leaf
    def back(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        force, memory[_FORCE] = restoring(p[_BACK:last], x, memory[_MOVED], memory[_FORCE], dt)
        memory[_MOVED] = x
        return float(force)

    return back


def _passing() -> _Through:
    """Return the kernel of an empty chain."""

    @leaf
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return at

    return through


@leaf
def _no_count(memory: FloatArray) -> float:
    return 0.0


def _counting(before: Any, place: int) -> Callable[[FloatArray], float]:
    @leaf
    def total(memory: FloatArray) -> float:
        return float(before(memory) + memory[place + CLAMPED])

    return total


def _before(one: _Through | None, other: _Through | None) -> _Through | None:
    """Return `one` followed by `other`; None if both are missing."""
    if one is None or other is None:
        return other if one is None else one

    @leaf
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return other(one(at, memory, p, dt), memory, p, dt)

    return through


def _solve(inverse: BlockInverse, place: int, numbers: int) -> _Through:
    """Return the step from the output of a block to its input."""
    solve = inverse.solve

    @leaf
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return Motion(solve(at.displacement, memory[place:], p[numbers:], dt), 0.0, 0.0)

    return through


def _keep(inverse: BlockInverse, place: int, numbers: int) -> _Through:
    """Return the step from the input of a block to its output, with an update of its memory."""
    commit = inverse.commit

    @leaf
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return Motion(commit(at.displacement, memory[place:], p[numbers:], dt), 0.0, 0.0)

    return through


def _undo(inverse: BlockInverse, place: int, numbers: int) -> _Through:
    """Return the step from the output of a block to its input with both derivatives."""
    solve, commit, shape = inverse.solve, inverse.commit, inverse.shape

    @leaf
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        own, numbers_of_it = memory[place:], p[numbers:]
        d = solve(at.displacement, own, numbers_of_it, dt)
        slope, bend = shape(d, own, numbers_of_it, dt)
        commit(d, own, numbers_of_it, dt)
        if slope == 0.0:
            slope = numbers_of_it[FIRST_SLOPE]
        v = at.velocity / slope
        return Motion(d, v, (at.acceleration - bend * v * v) / slope)

    return through
