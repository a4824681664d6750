"""Parallel connection of blocks: they have the same input, and their outputs are added.

In a chain they are one block whose name is theirs joined by ``|``:
``bouc_wen_exact|electrostriction``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.errors import ModelError

SEPARATOR = '|'


@dataclass(frozen=True)
class ParallelBlock(Block):
    """Several blocks with the same input, whose outputs are added."""

    parts: tuple[Block, ...] = ()

    @property
    def has_memory(self) -> bool:
        """Whether one of them has."""
        return any(part.has_memory for part in self.parts)

    @property
    def needs_levels(self) -> bool:
        """Whether one of them does."""
        return any(part.needs_levels for part in self.parts)

    def unknown_states(self, dt: float, *, memory: bool = True) -> tuple[int, ...]:
        """Return those of all, in the state of the sum."""
        if self.between is InterSample.PATH and not memory:
            return ()
        places, first = list[int](), 0
        for part in self.parts:
            places += [first + place for place in part.unknown_states(dt, memory=memory)]
            first += part.initial_state(dt).size
        return tuple(places)


def parts_of(block: Block) -> tuple[Block, ...]:
    """Return the parallel blocks of `block`; a single block is returned itself."""
    if not isinstance(block, ParallelBlock):
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

    return ParallelBlock(
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
        path_kernel=along if any(part.path_kernel is not None for part in parts) else None,
    )
