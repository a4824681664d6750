"""The index of an MCAP file from the file itself, so that nobody must keep it while recording."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator

from piezo_hysteresis.records import mcap_format as mcap

# First and last log time, size and checksum of the content, empty name of no compression, size.
_CHUNK = struct.Struct('<QQQIIQ')
_CHANNEL = struct.Struct('<H')


def chunk_indexes(file: int, start: int, end: int) -> Iterator[bytes]:
    """Yield the chunk index record of every chunk of a file.

    Parameters
    ----------
    file : int
        Descriptor of a file with uncompressed chunks, each followed by its message indexes.
    start, end : int
        Where its first record begins, and where the last one ends [byte].

    Raises
    ------
    OSError
        If it cannot be read.
    """
    at = start
    while at < end:
        head = os.pread(file, mcap.PREFIX.size + _CHUNK.size, at)
        opcode, size = mcap.PREFIX.unpack_from(head)
        after = at + mcap.PREFIX.size + size
        if opcode == mcap.CHUNK:
            chunk = _CHUNK.unpack_from(head, mcap.PREFIX.size)
            places, behind = _message_indexes(file, after, end)
            yield _chunk_index(chunk, at, after - at, places, behind - after)
            after = behind
        at = after


def _message_indexes(file: int, at: int, end: int) -> tuple[list[bytes], int]:
    """Return channel and place of the message indexes from `at` on, and where they end."""
    places = []
    while at < end:
        head = os.pread(file, mcap.PREFIX.size + _CHANNEL.size, at)
        opcode, size = mcap.PREFIX.unpack_from(head)
        if opcode != mcap.MESSAGE_INDEX:
            break
        places.append(head[mcap.PREFIX.size :] + struct.pack('<Q', at))
        at += mcap.PREFIX.size + size
    return places, at


def _chunk_index(
    chunk: tuple[int, ...], start: int, length: int, places: list[bytes], index_length: int
) -> bytes:
    first, last, content, _, _, stored = chunk
    return mcap.record(
        mcap.CHUNK_INDEX,
        struct.pack('<QQQQ', first, last, start, length),
        struct.pack('<I', 10 * len(places)),
        *places,
        struct.pack('<Q', index_length),
        mcap.text(''),
        struct.pack('<QQ', stored, content),
    )
