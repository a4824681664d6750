"""Blocks of whole periods, by which improvements are judged."""

from __future__ import annotations

from collections.abc import Sequence

# Length of the blocks by which improvements are judged [s], and how many there should be.
BLOCK = 0.3
FEWEST_BLOCKS = 40


def block_edges(
    sizes: Sequence[int], periods: Sequence[int], dts: Sequence[float]
) -> list[list[int]]:
    """Return the edges of blocks of whole periods, some 0.3 s or more, per view.

    Few slow periods make too few blocks to judge anything by; then parts of periods are taken.
    """
    lengths = []
    for period, dt in zip(periods, dts, strict=True):
        block = max(round(BLOCK / dt), 1)
        lengths.append(period * max(1, round(block / period)) if period else block)
    blocks = sum(size / length for size, length in zip(sizes, lengths, strict=True))
    shrink = min(1.0, blocks / FEWEST_BLOCKS)
    edges = []
    for size, length in zip(sizes, lengths, strict=True):
        count = max(1, int(size // max(shrink * length, 1.0)))
        edges.append([k * size // count for k in range(count + 1)])
    return edges
