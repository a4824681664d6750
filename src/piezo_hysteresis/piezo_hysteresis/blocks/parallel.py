"""Parallel connection of blocks: they have the same input, and their outputs are added.

In a chain they are one block whose name is theirs joined by ``|``:
``bouc_wen_exact|electrostriction``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.errors import ModelError

SEPARATOR = '|'


def parts_of(block: Block) -> tuple[Block, ...]:
    """Return the parallel blocks of `block`; a single block is returned itself."""
    if not block.parts:
        return (block,)
    known: tuple[Block, ...] | None = block.__dict__.get('_single')
    if known is not None:
        return known
    single = []
    first = 0
    for part in block.parts:
        last = first + len(part.parameters)
        single.append(replace(part, parameters=block.parameters[first:last]))
        first = last
    block.__dict__['_single'] = known = tuple(single)  # cached as long as the block
    return known


def _together(parts: tuple[Block, ...]) -> InterSample:
    """Return the intersample behaviour of the sum of these blocks."""
    kinds = {part.between for part in parts}
    if kinds <= {InterSample.INSTANT}:
        return InterSample.INSTANT
    return (
        InterSample.PATH if kinds <= {InterSample.INSTANT, InterSample.PATH} else InterSample.TICK
    )


def parallel_block(*blocks: Block) -> Block:
    """Return the parallel connection of `blocks`, in this order, as one block.

    Slot and source are those of the first block.
    """
    parts = tuple(part for block in blocks for part in parts_of(block))
    if len(parts) == 1:
        return parts[0]
    names = [parameter.name for part in parts for parameter in part.parameters]
    if len(set(names)) < len(names):
        raise ModelError(
            f'{" and ".join(part.name for part in parts)} share parameters and cannot be in '
            'parallel; omit one'
        )
    counts = np.cumsum([0, *(len(part.parameters) for part in parts)])

    @lru_cache(maxsize=8)
    def sizes(dt: float) -> list[int]:
        return [part.initial_state(dt).size for part in parts]

    def along(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float,
        frequency: float, points: int,
    ) -> None:  # fmt: skip
        y[:] = 0.0
        answer = np.empty_like(y)
        begin = 0
        for i, (part, size) in enumerate(zip(parts, sizes(dt), strict=True)):
            memory, own = state[begin : begin + size], p[counts[i] : counts[i + 1]]
            if points and part.path_kernel is not None:
                part.path_kernel(x, answer, memory, own, dt, frequency, points)
                y += answer
            else:
                y += part.respond(x, own, dt, state=memory, frequency=frequency)
            begin += size

    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        along(x, y, state, p, dt, frequency, 0)

    def check(values: Mapping[str, float]) -> str:
        for part in parts:
            own = {q.name: values[q.name] for q in part.parameters}
            reason = part.check(own) if part.check is not None else ''
            if reason:
                return reason
        return ''

    return Block(
        name=SEPARATOR.join(part.name for part in parts),
        slot=parts[0].slot,
        parameters=tuple(parameter for part in parts for parameter in part.parameters),
        kernel=kernel,
        state_size=lambda dt: sum(sizes(dt)),
        description='The sum of: ' + ' '.join(part.description for part in parts),
        source=parts[0].source,
        check=check,
        parts=parts,
        between=_together(parts),
        inertia=any(part.inertia for part in parts),
        path_kernel=along if any(part.path_kernel is not None for part in parts) else None,
        step_bound=any(part.step_bound for part in parts),
    )
