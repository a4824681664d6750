"""Blocks of whole periods for the block bootstrap."""

from __future__ import annotations

from collections.abc import Sequence


def block_edges(
    sizes: Sequence[int], periods: Sequence[int], dts: Sequence[float], seconds: float, fewest: int
) -> list[list[int]]:
    """Return the edges of blocks of whole periods, at least `seconds` long, per view.

    A few slow periods give too few blocks for a statistical test; parts of periods are then used.
    """
    lengths = []
    for period, dt in zip(periods, dts, strict=True):
        block = max(round(seconds / dt), 1)
        lengths.append(period * max(1, round(block / period)) if period else block)
    blocks = sum(size / length for size, length in zip(sizes, lengths, strict=True))
    shrink = min(1.0, blocks / fewest)
    edges = []
    for size, length in zip(sizes, lengths, strict=True):
        count = max(1, int(size // max(shrink * length, 1.0)))
        edges.append([k * size // count for k in range(count + 1)])
    return edges
