"""Layout of a run of blocks: indices of parameters and of states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, System
from piezo_hysteresis.blocks.transport_delay import in_ticks, ring_size


class PlacedBlock(NamedTuple):
    """A block and the indices of its parameters in the stage."""

    block: Block
    span: slice


class Layout(NamedTuple):
    """Layout of the state of a run.

    The first two states are the last output and the last held input.
    """

    ring: slice  # ring buffer of the delays; empty if there is none
    past: slice  # past samples of an interpolated input
    memories: list[slice]  # states of each block
    size: int  # size of the state


class StateJump(NamedTuple):
    """Offsets added to the state of a stage before one sample, for an unknown initial state."""

    sample: int  # sample before which they are added
    amounts: FloatArray  # offset of each state, shape (s,)

    def chunks(self, count: int, most: int, state: FloatArray) -> Iterator[slice]:
        """Yield `count` samples in limited portions; offsets are added to `state` in between."""
        begin = 0
        while begin < count:
            end = min(begin + most, count)
            if begin == self.sample:
                state += self.amounts
            elif begin < self.sample < end:
                end = self.sample
            yield slice(begin, end)
            begin = end


def layout_of(moving: Sequence[PlacedBlock], delays: int, past: int, dt: float) -> Layout:
    """Return the layout for blocks after the given number of delays and past samples."""
    ring = slice(2, 2 + (delays * ring_size(dt) + 1 if delays else 0))
    place = ring.stop + past
    memories = []
    for part in moving:
        size = part.block.initial_state(dt).size
        memories.append(slice(place, place + size))
        place += size
    return Layout(ring, slice(ring.stop, ring.stop + past), memories, place)


def delay_of(delays: FloatArray, dt: float, ahead: bool) -> tuple[int, float]:
    """Return the delay of the input in whole ticks, and the part of a tick to sample after."""
    if not delays.size:
        return 0, 1.0 if ahead else 0.0
    whole, part = in_ticks(float(delays.sum()), dt)
    return whole if ahead else whole + 1, 1.0 - part


def systems_of(parts: Sequence[PlacedBlock], p: FloatArray) -> list[System]:
    """Return the linear systems among `parts`."""
    return [part.block.system(p[part.span]) for part in parts if part.block.system is not None]
