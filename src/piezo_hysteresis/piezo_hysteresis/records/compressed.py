"""Bags that ``ros2 bag record`` compressed, by file or by message."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import MessageBlock, Storage, Topic

PIECE = 1 << 20

# Largest decompressed block: chunks of `ros2 bag record` contain 768 kB, the largest of others
# some 10 MB. In memory a chunk takes about four times its size.
LARGEST = 1 << 28

# A whole file may be this much larger than it was packed, whatever its size; black pictures are
# 10 000 times as large, but the states of an actuator that does nothing only 40 times.
RATIO, SMALL = 1000, 1 << 30


def inflated(data: bytes, compression: str, size: int = LARGEST) -> bytes:
    """Return the content of a chunk or message, at most `size` + 1 bytes."""
    if size > LARGEST:
        raise ValueError(f'it would take {size} bytes, at most {LARGEST} are read at once')
    if compression == '':
        return data
    if compression == 'lz4':
        from lz4.frame import LZ4FrameDecompressor

        return bytes(LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    if compression == 'zstd':
        # rosbags brings this module, the standard one of Python 3.14, along.
        from backports import zstd

        try:
            return bytes(zstd.ZstdDecompressor().decompress(data, max_length=size + 1))
        except zstd.ZstdError as error:
            raise ValueError(str(error)) from None
    raise ValueError(f'compression {compression!r} is not known')


class CompressedFile:
    """A storage file compressed as a whole (``.mcap.zstd``, ``.db3.zstd``)."""

    def __init__(
        self, path: Path, log: DamageLog, reader: Callable[[Path, DamageLog], Storage]
    ) -> None:
        self.path = path
        self.log = log
        self.topics: dict[int, Topic] = {}
        self._reader = reader

    def blocks(self) -> Generator[MessageBlock]:
        """Yield the blocks of the uncompressed file, which is in a temporary folder."""
        from backports import zstd

        with tempfile.TemporaryDirectory() as folder:
            plain = Path(folder) / self.path.stem
            most = max(SMALL, RATIO * self.path.stat().st_size)
            try:
                with zstd.open(self.path, 'rb') as source, plain.open('wb') as target:
                    while piece := source.read(PIECE):
                        if target.tell() > most:
                            raise EOFError(f'it holds more than {most} bytes')
                        target.write(piece)
            except (zstd.ZstdError, EOFError) as error:
                self.log.add(self.path, f'it cannot be decompressed to its end ({error})')
            storage = self._reader(plain, self.log)
            for block in storage.blocks():
                self.topics = storage.topics
                yield block


def decompressed(block: MessageBlock, path: Path, log: DamageLog) -> MessageBlock:
    """Return a block of individually compressed messages."""
    payloads, good, left = [], np.ones(block.topic.size, np.bool_), LARGEST
    for index in range(block.topic.size):
        try:
            payload = inflated(block.payload(index), 'zstd')
        except ValueError:
            good[index] = False
            continue
        left -= len(payload)
        if left < 0:
            log.add(path, f'its messages are larger than {LARGEST} bytes, decompressed')
            good[index:] = False
            break
        payloads.append(payload)
    bad = int(good.size - good.sum())
    if bad:
        log.add(path, f'{bad} messages cannot be decompressed', count=bad, lost=bad)
    length: IntArray = np.array([len(payload) for payload in payloads], np.int64)
    return MessageBlock(
        np.frombuffer(b''.join(payloads), np.uint8),
        block.topic[good],
        block.log_time[good],
        np.cumsum(length) - length,
        length,
    )
